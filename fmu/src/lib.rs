//! The C functions of FMI 3.0 co-simulation over [`hil_sim::fmu::Instance`].
//!
//! The types and signatures are those of `fmi3FunctionTypes.h`. A handle is a pointer to a
//! `Component`, made by `fmi3InstantiateCoSimulation` and released by `fmi3FreeInstance`. Each
//! function catches panics, which must not cross into C; after one the component only returns
//! `fmi3Fatal`. Why a function failed is sent to the importer's log, with the importer's own
//! pointer, whether or not the debug log is on.

mod component;
mod unsupported;

use component::{Component, LogMessage, Status, text, with};
use std::ffi::{c_char, c_void};
use std::path::Path;

/// The version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Does nothing: errors are always sent, and there is no other message.
///
/// # Safety
/// `instance` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetDebugLogging(
    instance: *mut c_void,
    _logging_on: bool,
    _n_categories: usize,
    _categories: *const *const c_char,
) -> Status {
    // SAFETY: the caller's contract.
    unsafe { with(instance, |_| Ok(())) }
}

/// An instance of the rig in the folder `resource_path`; null if there is none.
///
/// # Safety
/// The strings end with 0 and the callback may be called, as the standard says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _instance_name: *const c_char,
    instantiation_token: *const c_char,
    resource_path: *const c_char,
    _visible: bool,
    _logging_on: bool,
    _event_mode_used: bool,
    _early_return_allowed: bool,
    _required_intermediate_variables: *const u32,
    _n_required_intermediate_variables: usize,
    environment: *mut c_void,
    log_message: Option<LogMessage>,
    _intermediate_update: *const c_void,
) -> *mut c_void {
    // SAFETY: the caller's contract.
    let words = unsafe { (text(instantiation_token), text(resource_path)) };
    let (Some(token), Some(folder)) = words else {
        let error = "expected an instantiation token and a path of the resources, found null";
        component::log(environment, log_message, error);
        return std::ptr::null_mut();
    };
    match Component::new(&token, Path::new(&folder), environment, log_message) {
        Ok(component) => Box::into_raw(Box::new(component)).cast(),
        Err(error) => {
            component::log(environment, log_message, &error);
            std::ptr::null_mut()
        }
    }
}

/// Releases an instance.
///
/// # Safety
/// `instance` is null or a live handle, which is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: the handle came from `Box::into_raw` in `fmi3InstantiateCoSimulation`.
        drop(unsafe { Box::from_raw(instance.cast::<Component>()) });
    }
}

/// Begins the initialization.
///
/// # Safety
/// `instance` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: *mut c_void,
    tolerance_defined: bool,
    tolerance: f64,
    start_time: f64,
    _stop_time_defined: bool,
    _stop_time: f64,
) -> Status {
    let tolerance = tolerance_defined.then_some(tolerance);
    // SAFETY: the caller's contract.
    unsafe {
        with(instance, |model| {
            model.enter_initialization(start_time, tolerance)
        })
    }
}

/// Ends the initialization.
///
/// # Safety
/// `instance` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitInitializationMode(instance: *mut c_void) -> Status {
    // SAFETY: the caller's contract.
    unsafe { with(instance, |model| model.exit_initialization()) }
}

/// Ends the simulation.
///
/// # Safety
/// `instance` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Terminate(instance: *mut c_void) -> Status {
    // SAFETY: the caller's contract.
    unsafe { with(instance, |model| model.terminate()) }
}

/// Returns to the state after the instantiation.
///
/// # Safety
/// `instance` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(instance: *mut c_void) -> Status {
    let reset = |model: &mut hil_sim::fmu::Instance| {
        model.reset();
        Ok(())
    };
    // SAFETY: the caller's contract.
    unsafe { with(instance, reset) }
}

/// Simulates one communication step.
///
/// # Safety
/// `instance` is a live handle, and each result pointer is null or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    instance: *mut c_void,
    current_communication_point: f64,
    communication_step_size: f64,
    _no_set_fmu_state_prior_to_current_point: bool,
    event_handling_needed: *mut bool,
    terminate_simulation: *mut bool,
    early_return: *mut bool,
    last_successful_time: *mut f64,
) -> Status {
    for flag in [event_handling_needed, terminate_simulation, early_return] {
        if !flag.is_null() {
            // SAFETY: it is not null, and the caller's contract.
            unsafe { flag.write(false) };
        }
    }
    let step = |model: &mut hil_sim::fmu::Instance| {
        let reached_s = model.step(current_communication_point, communication_step_size)?;
        if !last_successful_time.is_null() {
            // SAFETY: it is not null, and the caller's contract.
            unsafe { last_successful_time.write(reached_s) };
        }
        Ok(())
    };
    // SAFETY: the caller's contract.
    unsafe { with(instance, step) }
}

/// Getter and setter of one type, whose values are numbers to the model.
macro_rules! access {
    ($get:ident, $set:ident, $type:ty, $is_boolean:expr, $read:expr, $write:expr) => {
        /// Reads variables of this type.
        ///
        /// # Safety
        /// `instance` is a live handle, and the arrays have their lengths.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $get(
            instance: *mut c_void,
            references: *const u32,
            n_references: usize,
            values: *mut $type,
            n_values: usize,
        ) -> Status {
            let get = |model: &mut hil_sim::fmu::Instance| {
                // SAFETY: the caller's contract.
                let references = unsafe { component::array(references, n_references)? };
                component::expect_values(values, n_values, n_references)?;
                for (place, reference) in references.iter().enumerate() {
                    let value = model.get(*reference, $is_boolean)?;
                    // SAFETY: there are as many values as references.
                    unsafe { values.add(place).write($read(value)) };
                }
                Ok(())
            };
            // SAFETY: the caller's contract.
            unsafe { with(instance, get) }
        }

        /// Sets variables of this type.
        ///
        /// # Safety
        /// `instance` is a live handle, and the arrays have their lengths.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $set(
            instance: *mut c_void,
            references: *const u32,
            n_references: usize,
            values: *const $type,
            n_values: usize,
        ) -> Status {
            let set = |model: &mut hil_sim::fmu::Instance| {
                component::expect_values(values, n_values, n_references)?;
                // SAFETY: the caller's contract.
                let references = unsafe { component::array(references, n_references)? };
                // SAFETY: the caller's contract.
                let values = unsafe { component::array(values, n_values)? };
                for (reference, value) in references.iter().zip(values) {
                    model.set(*reference, $is_boolean, $write(*value))?;
                }
                Ok(())
            };
            // SAFETY: the caller's contract.
            unsafe { with(instance, set) }
        }
    };
}

access!(
    fmi3GetFloat64,
    fmi3SetFloat64,
    f64,
    false,
    |value| value,
    |value| value
);
// A `bool` of C as its byte: Rust's must not have another value than 0 and 1.
access!(
    fmi3GetBoolean,
    fmi3SetBoolean,
    u8,
    true,
    |value| u8::from(value == 1.0),
    |value| f64::from(u8::from(value != 0))
);

#[cfg(test)]
mod tests;
