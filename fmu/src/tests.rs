//! The functions as an importer calls them.

use super::*;
use crate::unsupported::{fmi3GetInt32, fmi3InstantiateModelExchange};
use component::{ERROR, FATAL, OK};
use hil_sim::fmu::{Experiment, Instance, Model, RIG_FILE, STARTS_FILE};
use hil_sim::rig::Rig;
use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};

/// The importer's environment: what it was told.
type Messages = Vec<(Status, String)>;

unsafe extern "C" fn keep(
    environment: *mut c_void,
    status: Status,
    category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: the environment is that of `Imported`, and the strings live.
    let (messages, [category, message]) = unsafe {
        let words = [category, message].map(|text| CStr::from_ptr(text));
        (&mut *environment.cast::<Messages>(), words)
    };
    assert_eq!(category, c"logStatusError");
    messages.push((status, message.to_string_lossy().into_owned()));
}

/// An instance of the paper's rig, and its messages.
struct Imported {
    handle: *mut c_void,
    messages: *mut Messages,
    description: String,
    _resources: tempfile::TempDir,
}

impl Imported {
    fn new(token: Option<&str>) -> Imported {
        let folder = tempfile::tempdir().expect("a folder");
        let model = Model::new("rig.toml", Rig::REFERENCE_TOML).expect("a model");
        std::fs::write(folder.path().join(RIG_FILE), Rig::REFERENCE_TOML).expect("written");
        std::fs::write(folder.path().join(STARTS_FILE), model.starts()).expect("written");
        let description = model.description("rig", Experiment::default());
        let is = description
            .split("instantiationToken=\"")
            .nth(1)
            .expect("a token");
        let is = is.split('"').next().expect("its end");
        let token = CString::new(token.unwrap_or(is)).expect("no zero");
        let path = CString::new(folder.path().to_str().expect("UTF-8")).expect("no zero");
        let messages = Box::into_raw(Box::<Messages>::default());
        // SAFETY: all pointers live.
        let handle = unsafe {
            fmi3InstantiateCoSimulation(
                c"rig".as_ptr(),
                token.as_ptr(),
                path.as_ptr(),
                false,
                false,
                false,
                false,
                null(),
                0,
                messages.cast(),
                Some(keep),
                null(),
            )
        };
        Imported {
            handle,
            messages,
            description,
            _resources: folder,
        }
    }

    fn reference(&self, name: &str) -> u32 {
        let after = self
            .description
            .split(&format!("name=\"{name}\" valueReference=\""))
            .nth(1);
        let digits = after.expect("the variable").split('"').next();
        digits
            .and_then(|digits| digits.parse().ok())
            .expect("a number")
    }

    fn messages(&mut self) -> Messages {
        // SAFETY: it came from a box, and no function of the FMU runs.
        std::mem::take(unsafe { &mut *self.messages })
    }
}

impl Drop for Imported {
    fn drop(&mut self) {
        // SAFETY: both came from boxes.
        unsafe {
            fmi3FreeInstance(self.handle);
            drop(Box::from_raw(self.messages));
        }
    }
}

#[test]
fn a_weight_is_lifted() {
    let rig = Imported::new(None);
    assert!(!rig.handle.is_null());
    let [pressure_ref_pa, contraction] =
        ["pressure_ref_pa", "contraction"].map(|name| rig.reference(name));
    let mut found = [0.0];
    let mut reached_s = 0.0;
    // SAFETY: the handle lives, and the arrays have their lengths.
    unsafe {
        assert_eq!(fmi3SetDebugLogging(rig.handle, false, 0, null()), OK);
        assert_eq!(
            fmi3EnterInitializationMode(rig.handle, true, 1e-6, 0.0, false, 0.0),
            OK
        );
        assert_eq!(fmi3ExitInitializationMode(rig.handle), OK);
        assert_eq!(fmi3SetFloat64(rig.handle, &pressure_ref_pa, 1, &3e5, 1), OK);
        for tick in 0..300 {
            let time_s = 0.01 * f64::from(tick);
            let [mut event, mut end, mut early] = [true; 3];
            let step = fmi3DoStep(
                rig.handle,
                time_s,
                0.01,
                true,
                &mut event,
                &mut end,
                &mut early,
                &mut reached_s,
            );
            assert_eq!((step, event, end, early), (OK, false, false, false));
        }
        assert_eq!(
            fmi3GetFloat64(rig.handle, &contraction, 1, found.as_mut_ptr(), 1),
            OK
        );
        assert_eq!(fmi3Terminate(rig.handle), OK);
        assert_eq!(fmi3Reset(rig.handle), OK);
    }
    assert!((reached_s - 3.0).abs() < 1e-12);
    // Where 300 kPa carry 12 kg, but for the friction at rest.
    assert!((found[0] - 0.2036).abs() < 0.01, "{found:?}");
}

#[test]
fn an_error_is_told_with_the_importers_environment() {
    let mut rig = Imported::new(None);
    let mass = rig.reference("load.mass_kg");
    let mut number = 0;
    // SAFETY: the handle lives, and the arrays have their lengths or are null.
    unsafe {
        assert_eq!(fmi3SetFloat64(rig.handle, &mass, 1, &-1.0, 1), ERROR);
        assert_eq!(fmi3SetFloat64(rig.handle, &mass, 1, &1.0, 2), ERROR);
        assert_eq!(fmi3SetFloat64(rig.handle, null(), 1, &1.0, 1), ERROR);
        assert_eq!(fmi3GetFloat64(rig.handle, &mass, 1, null_mut(), 1), ERROR);
        assert_eq!(fmi3GetInt32(rig.handle, &mass, 1, &mut number, 1), ERROR);
        assert_eq!(fmi3GetFloat64(rig.handle, null(), 0, null_mut(), 0), OK);
        assert_eq!(fmi3SetFloat64(null_mut(), &mass, 1, &1.0, 1), ERROR);
        fmi3FreeInstance(null_mut());
    }
    let messages = rig.messages();
    let expected = [
        "variable `load.mass_kg`: expected a number from 0.001 to 1e5, found -1",
        "expected 1 values, found 2",
        "expected an array of 1, found null",
        "expected an array of 1, found null",
        "expected a function that the model description offers, found fmi3GetInt32",
    ];
    let expected = expected.map(|message| (ERROR, message.to_owned()));
    assert_eq!(messages, expected);
}

#[test]
fn a_rig_of_another_description_is_no_instance() {
    let mut other = Imported::new(Some("of another rig"));
    assert!(other.handle.is_null());
    let messages = other.messages();
    assert!(
        messages.len() == 1 && messages[0].1.ends_with("export the FMU again"),
        "{messages:?}"
    );
    let environment = other.messages.cast();
    let path = c"/nowhere";
    let none = fmi3InstantiateModelExchange(
        path.as_ptr(),
        path.as_ptr(),
        path.as_ptr(),
        false,
        false,
        environment,
        Some(keep),
    );
    assert!(none.is_null() && other.messages().len() == 1);
    // SAFETY: all pointers live or are null.
    let missing = |folder: *const c_char| unsafe {
        fmi3InstantiateCoSimulation(
            c"".as_ptr(),
            c"".as_ptr(),
            folder,
            false,
            false,
            false,
            false,
            null(),
            0,
            environment,
            Some(keep),
            null(),
        )
    };
    assert!(missing(path.as_ptr()).is_null() && missing(null()).is_null());
    let messages = other.messages();
    assert!(messages[0].1.contains("/nowhere/rig.toml"), "{messages:?}");
    assert_eq!(messages.len(), 2);
}

/// A panic does not reach the importer, and the instance is not used again.
#[test]
fn a_panic_ends_the_use_of_an_instance() {
    let mut rig = Imported::new(None);
    // SAFETY: the handle lives.
    unsafe {
        let panics = |_: &mut Instance| panic!("on purpose");
        assert_eq!(component::with(rig.handle, panics), FATAL);
        assert_eq!(fmi3Reset(rig.handle), FATAL);
    }
    assert_eq!(
        rig.messages(),
        [(FATAL, "internal error: on purpose".to_owned())]
    );
}
