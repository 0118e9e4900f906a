//! The functions of FMI 3.0 for what the model description does not offer: other types, states that
//! are saved, derivatives, clocks, event mode, and the two other kinds of FMU. An importer may look
//! all of them up; each returns `fmi3Error` and says so.

use crate::component::{LogMessage, Status, log, with};
use std::ffi::{c_char, c_int, c_void};

macro_rules! unsupported {
    ($($name:ident($($argument:ty),*);)*) => {
        $(
            /// Returns `fmi3Error`.
            ///
            /// # Safety
            /// `instance` is null or a live handle.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $name(instance: *mut c_void, $(_: $argument),*) -> Status {
                let error = concat!(
                    "expected a function that the model description offers, found ",
                    stringify!($name)
                );
                // SAFETY: the caller's contract.
                unsafe { with(instance, |_| Err(error.into())) }
            }
        )*
    };
}

unsupported! {
    fmi3GetFloat32(*const u32, usize, *mut f32, usize);
    fmi3SetFloat32(*const u32, usize, *const f32, usize);
    fmi3GetInt8(*const u32, usize, *mut i8, usize);
    fmi3SetInt8(*const u32, usize, *const i8, usize);
    fmi3GetUInt8(*const u32, usize, *mut u8, usize);
    fmi3SetUInt8(*const u32, usize, *const u8, usize);
    fmi3GetInt16(*const u32, usize, *mut i16, usize);
    fmi3SetInt16(*const u32, usize, *const i16, usize);
    fmi3GetUInt16(*const u32, usize, *mut u16, usize);
    fmi3SetUInt16(*const u32, usize, *const u16, usize);
    fmi3GetInt32(*const u32, usize, *mut i32, usize);
    fmi3SetInt32(*const u32, usize, *const i32, usize);
    fmi3GetUInt32(*const u32, usize, *mut u32, usize);
    fmi3SetUInt32(*const u32, usize, *const u32, usize);
    fmi3GetInt64(*const u32, usize, *mut i64, usize);
    fmi3SetInt64(*const u32, usize, *const i64, usize);
    fmi3GetUInt64(*const u32, usize, *mut u64, usize);
    fmi3SetUInt64(*const u32, usize, *const u64, usize);
    fmi3GetString(*const u32, usize, *mut *const c_char, usize);
    fmi3SetString(*const u32, usize, *const *const c_char, usize);
    fmi3GetBinary(*const u32, usize, *mut usize, *mut *const u8, usize);
    fmi3SetBinary(*const u32, usize, *const usize, *const *const u8, usize);
    fmi3GetClock(*const u32, usize, *mut bool);
    fmi3SetClock(*const u32, usize, *const bool);
    fmi3GetNumberOfVariableDependencies(u32, *mut usize);
    fmi3GetVariableDependencies(u32, *mut usize, *mut u32, *mut usize, *mut c_int, usize);
    fmi3GetFMUState(*mut *mut c_void);
    fmi3SetFMUState(*mut c_void);
    fmi3FreeFMUState(*mut *mut c_void);
    fmi3SerializedFMUStateSize(*mut c_void, *mut usize);
    fmi3SerializeFMUState(*mut c_void, *mut u8, usize);
    fmi3DeserializeFMUState(*const u8, usize, *mut *mut c_void);
    fmi3GetDirectionalDerivative(
        *const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize
    );
    fmi3GetAdjointDerivative(
        *const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize
    );
    fmi3EnterConfigurationMode();
    fmi3ExitConfigurationMode();
    fmi3EnterEventMode();
    fmi3EnterStepMode();
    fmi3GetIntervalDecimal(*const u32, usize, *mut f64, *mut c_int);
    fmi3GetIntervalFraction(*const u32, usize, *mut u64, *mut u64, *mut c_int);
    fmi3GetShiftDecimal(*const u32, usize, *mut f64);
    fmi3GetShiftFraction(*const u32, usize, *mut u64, *mut u64);
    fmi3SetIntervalDecimal(*const u32, usize, *const f64);
    fmi3SetIntervalFraction(*const u32, usize, *const u64, *const u64);
    fmi3SetShiftDecimal(*const u32, usize, *const f64);
    fmi3SetShiftFraction(*const u32, usize, *const u64, *const u64);
    fmi3EvaluateDiscreteStates();
    fmi3UpdateDiscreteStates(*mut bool, *mut bool, *mut bool, *mut bool, *mut bool, *mut f64);
    fmi3EnterContinuousTimeMode();
    fmi3CompletedIntegratorStep(bool, *mut bool, *mut bool);
    fmi3SetTime(f64);
    fmi3SetContinuousStates(*const f64, usize);
    fmi3GetContinuousStates(*mut f64, usize);
    fmi3GetContinuousStateDerivatives(*mut f64, usize);
    fmi3GetNominalsOfContinuousStates(*mut f64, usize);
    fmi3GetNumberOfContinuousStates(*mut usize);
    fmi3GetEventIndicators(*mut f64, usize);
    fmi3GetNumberOfEventIndicators(*mut usize);
    fmi3ActivateModelPartition(u32, f64);
    fmi3GetOutputDerivatives(*const u32, usize, *const i32, *mut f64, usize);
}

/// Returns null: the FMU is for co-simulation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange(
    _instance_name: *const c_char,
    _instantiation_token: *const c_char,
    _resource_path: *const c_char,
    _visible: bool,
    _logging_on: bool,
    environment: *mut c_void,
    log_message: Option<LogMessage>,
) -> *mut c_void {
    log(
        environment,
        log_message,
        "expected co-simulation, found model exchange",
    );
    std::ptr::null_mut()
}

/// Returns null: the FMU is for co-simulation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution(
    _instance_name: *const c_char,
    _instantiation_token: *const c_char,
    _resource_path: *const c_char,
    _visible: bool,
    _logging_on: bool,
    environment: *mut c_void,
    log_message: Option<LogMessage>,
    _clock_update: *const c_void,
    _lock_preemption: *const c_void,
    _unlock_preemption: *const c_void,
) -> *mut c_void {
    log(
        environment,
        log_message,
        "expected co-simulation, found scheduled execution",
    );
    std::ptr::null_mut()
}
