//! Flipped bits in the device's memory.

use model_core::device::Hil;
use model_core::voted::Voted;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Flips one bit of a value, of whichever field, valid or not: bit `bit` modulo their number in its
/// encoding, or the next one with which it is another value. A bit that says whether a field is
/// there makes others of all behind it.
pub fn flip<T: Serialize + DeserializeOwned + PartialEq>(value: &mut T, bit: usize) {
    let mut buffer = [0; 1024];
    let len = postcard::to_slice(value, &mut buffer).map_or(0, |encoded| encoded.len());
    for bit in (0..8 * len).map(|later| (bit + later) % (8 * len)) {
        let mut flipped = buffer;
        flipped[bit / 8] ^= 1 << (bit % 8);
        match postcard::from_bytes::<T>(&flipped) {
            Ok(other) if other != *value => {
                *value = other;
                return;
            }
            _ => {}
        }
    }
}

/// Flips a bit in the copy of this number; in the inverted one as in the others.
pub fn flip_copy<T: Copy + PartialEq + Serialize, const N: usize>(
    voted: &mut Voted<T, N>,
    copy: usize,
    flip: impl Fn(&mut T),
) {
    if let Some(plain) = voted.plain_mut().get_mut(copy) {
        return flip(plain);
    }
    let mut flipped = *voted.get();
    flip(&mut flipped);
    voted.set_inverted(&flipped);
}

/// Switches hardware in the loop on or off.
pub fn flip_hil(hil: &mut Option<Hil>) {
    *hil = match hil {
        None => Some(Hil::default()),
        Some(_) => None,
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::controller::Controller;
    use model_core::io::Sensors;
    use model_core::settings::{Settings, SettingsValues};
    use std::collections::BTreeSet;

    /// Each byte of the encoding is reached but one, and each bit makes another value.
    #[test]
    fn every_field_is_flipped() {
        fn values<T: Serialize + DeserializeOwned + PartialEq + Copy>(of: T) -> usize {
            let encoded = |value: &T| {
                let mut buffer = [0; 1024];
                postcard::to_slice(value, &mut buffer)
                    .expect("it fits")
                    .to_vec()
            };
            let before = encoded(&of);
            let mut reached = BTreeSet::new();
            for bit in 0..8 * before.len() {
                let mut value = of;
                flip(&mut value, bit);
                assert!(value != of);
                let after = encoded(&value);
                let pairs = before.iter().zip(&after).enumerate();
                reached.extend(pairs.filter(|(_, (a, b))| a != b).map(|(byte, _)| byte));
            }
            // Without the latched fault nothing behind it is a state.
            assert!(reached.len() + 1 >= before.len(), "{}", reached.len());
            before.len()
        }
        assert!(values(SettingsValues::reference()) > 150);
        // After some ticks, so that there is something in all of it.
        let settings = Settings::new(SettingsValues::reference()).expect("settings");
        let mut controller = Controller::new(settings);
        for _ in 0..10 {
            controller.tick(&Sensors::default());
        }
        assert!(values(*controller.state()) > 80);
    }
}
