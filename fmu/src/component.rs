//! The object behind a handle, and what all functions share.

use hil_sim::error::BadInput;
use hil_sim::fmu::{Instance, Model, RIG_FILE, STARTS_FILE};
use hil_sim::input::read_text;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// `fmi3Status`.
pub type Status = c_int;
/// `fmi3OK`.
pub const OK: Status = 0;
/// `fmi3Error`: the importer may reset or free the instance.
pub const ERROR: Status = 3;
/// `fmi3Fatal`: no instance can be used any more.
pub const FATAL: Status = 4;

/// `fmi3LogMessageCallback`: environment, status, category, message.
pub type LogMessage = unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char);

/// The object behind a handle.
pub struct Component {
    instance: Instance,
    /// The importer's, given back to it with each message.
    environment: *mut c_void,
    log_message: Option<LogMessage>,
    /// A function has panicked: the instance may be inconsistent.
    has_panicked: bool,
}

impl Component {
    /// The rig in the folder of resources.
    ///
    /// # Errors
    /// There is no rig, or it is that of another model description.
    pub fn new(
        token: &str,
        resources: &Path,
        environment: *mut c_void,
        log_message: Option<LogMessage>,
    ) -> Result<Component, String> {
        let instance = caught(|| {
            let read = |file| {
                let path = resources.join(file);
                Ok((
                    path.display().to_string(),
                    read_text(&path, "a readable file of the FMU")?,
                ))
            };
            let model = || -> Result<Model, BadInput> {
                let (name, text) = read(RIG_FILE)?;
                let mut model = Model::new(&name, &text)?;
                let (name, text) = read(STARTS_FILE)?;
                model.set_starts(&name, &text)?;
                Ok(model)
            };
            Instance::new(model().map_err(|error| error.to_string())?, token)
        });
        Ok(Component {
            instance: instance.unwrap_or_else(Err)?,
            environment,
            log_message,
            has_panicked: false,
        })
    }
}

/// The result of `work`, or the message of its panic.
fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| {
        let words = panic.downcast_ref::<String>().map(String::as_str);
        let words = words.or_else(|| panic.downcast_ref::<&str>().copied());
        format!("internal error: {}", words.unwrap_or("unknown"))
    })
}

/// Sends why a function returns `fmi3Error` to the importer, if it wants messages.
pub fn log(environment: *mut c_void, log_message: Option<LogMessage>, error: &str) {
    send(environment, log_message, ERROR, error);
}

fn send(environment: *mut c_void, log_message: Option<LogMessage>, status: Status, error: &str) {
    let Some(log_message) = log_message else {
        return;
    };
    let message = CString::new(error.replace('\0', " ")).unwrap_or_default();
    // SAFETY: the importer gave the function and its environment for this; the strings live until
    // it returns.
    unsafe {
        log_message(
            environment,
            status,
            c"logStatusError".as_ptr(),
            message.as_ptr(),
        )
    };
}

/// Does `work` on the instance of a handle, and sends its error.
///
/// # Safety
/// `handle` is null or a live handle, and no other function uses it now.
pub unsafe fn with(
    handle: *mut c_void,
    work: impl FnOnce(&mut Instance) -> Result<(), String>,
) -> Status {
    // SAFETY: the caller's contract.
    let Some(component) = (unsafe { handle.cast::<Component>().as_mut() }) else {
        return ERROR;
    };
    if component.has_panicked {
        return FATAL;
    }
    let result = caught(|| work(&mut component.instance));
    component.has_panicked = result.is_err();
    let status = if result.is_err() { FATAL } else { ERROR };
    match result.unwrap_or_else(Err) {
        Ok(()) => OK,
        Err(error) => {
            send(component.environment, component.log_message, status, &error);
            status
        }
    }
}

/// The text at `pointer`; `None` if it is null.
///
/// # Safety
/// It is null or ends with 0.
pub unsafe fn text(pointer: *const c_char) -> Option<String> {
    if pointer.is_null() {
        return None;
    }
    // SAFETY: it is not null, and the caller's contract.
    let text = unsafe { CStr::from_ptr(pointer) };
    Some(text.to_string_lossy().into_owned())
}

/// An array of C, which may be null if it is empty.
///
/// # Safety
/// A pointer that is not null has `length` values, which do not change while the result is used.
///
/// # Errors
/// The pointer is null, and the length is not 0.
pub unsafe fn array<'a, T>(pointer: *const T, length: usize) -> Result<&'a [T], String> {
    match (length, pointer.is_null()) {
        (0, _) => Ok(&[]),
        (_, true) => Err(format!("expected an array of {length}, found null")),
        // SAFETY: it is not null, and the caller's contract.
        (_, false) => Ok(unsafe { std::slice::from_raw_parts(pointer, length) }),
    }
}

/// Refuses values that are null or not one for each reference: all variables are scalars.
///
/// # Errors
/// They are.
pub fn expect_values<T>(
    values: *const T,
    n_values: usize,
    n_references: usize,
) -> Result<(), String> {
    if n_values != n_references {
        return Err(format!("expected {n_references} values, found {n_values}"));
    }
    match values.is_null() && n_values > 0 {
        true => Err(format!("expected an array of {n_values}, found null")),
        false => Ok(()),
    }
}
