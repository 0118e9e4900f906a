//! Settings from the link: the safety block changes only with an action at the device.
//!
//! ```text
//! link ─ offer ─▶ SettingsGate ─ number ─▶ Confirmation ◀─ button, for 2 s
//!                      │    ◀─ verdict ──────┘
//!                      └─ Store, or an answer
//! ```
//!
//! The gate is with the link, the confirmation with the button, which another task of the firmware
//! reads. What is stored is what was offered when the lamp began to ask: another offer meanwhile
//! ends both.

use crate::limits::agree;
use crate::settings::{Settings, SettingsValues};
use serde::{Deserialize, Serialize};

/// Ticks for which the button must be held: 2 s, longer than any press with another purpose.
pub const HELD_TICKS: u16 = 200;
/// Ticks after which the question ends: 30 s, in which a person walks from the PC to the device.
pub const ASKED_TICKS: u16 = 3000;

/// Who has changed settings, and when, as the PC tells; the board has no clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Signature {
    /// Seconds since 1970, UTC; 0: not known.
    pub utc_s: u32,
    /// The first bytes of a person's or a program's name, in UTF-8; zeros: not known.
    pub author: Author,
    /// The button was held for it. The board tells; what the PC writes here has no effect.
    pub is_confirmed: bool,
}

/// A name: UTF-8, and zeros to its end.
pub type Author = [u8; 16];

/// Result of storing settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Written {
    /// The settings are stored: the board restarts.
    Stored,
    /// The muscle is or may be under pressure.
    Armed,
    /// A value is outside its limits or contradicts another.
    Invalid,
    /// The flash has failed: the board restarts with the newest settings that it can read.
    FlashFailed,
    /// The safety block differs: the button must be held, within 30 s. Another answer follows.
    AwaitsButton,
    /// The button was not held for long enough, or other settings were written meanwhile.
    NotConfirmed,
}

/// What was done at the device about the proposal of that number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The number of the proposal.
    pub number: u32,
    /// The button was held for long enough.
    pub is_confirmed: bool,
}

/// The button's part: it counts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Confirmation {
    proposed: Option<u32>,
    asked_ticks: u16,
    held_ticks: u16,
    /// The button has been seen released since the question.
    was_released: bool,
}

impl Confirmation {
    /// Begins to ask for the proposal of this number, or ends to ask.
    pub fn propose(&mut self, proposed: Option<u32>) {
        *self = Confirmation {
            proposed,
            ..Confirmation::default()
        };
    }

    /// The lamp asks.
    pub fn is_asking(&self) -> bool {
        self.proposed.is_some()
    }

    /// The button is held, for this proposal.
    pub fn is_held(&self) -> bool {
        self.is_asking() && self.held_ticks > 0
    }

    /// One tick. A button that is pressed already when the question begins does not count; one that
    /// is released too early, and a device that is armed, end the question.
    pub fn tick(&mut self, is_pressed: bool, is_armed: bool) -> Option<Verdict> {
        let number = self.proposed?;
        self.asked_ticks = self.asked_ticks.saturating_add(1);
        let was_held = self.held_ticks > 0;
        self.was_released |= !is_pressed;
        self.held_ticks = if is_pressed && self.was_released {
            self.held_ticks.saturating_add(1)
        } else {
            0
        };
        let is_confirmed = self.held_ticks >= HELD_TICKS && !is_armed;
        let is_released = was_held && !is_pressed;
        let is_late = self.asked_ticks >= ASKED_TICKS;
        if !(is_confirmed || is_released || is_late || is_armed) {
            return None;
        }
        self.propose(None);
        Some(Verdict {
            number,
            is_confirmed,
        })
    }
}

/// What the link's task has to do.
#[derive(Clone, Copy, Debug, PartialEq)]
// There is no heap, and it lives for a moment.
#[allow(clippy::large_enum_variant)]
pub enum Decision {
    /// Answer this.
    Answer(Written),
    /// Store the settings, unless the device is armed by now, answer, and restart.
    Store(Settings, Signature),
    /// Ask at the device for the proposal of this number, and answer [`Written::AwaitsButton`].
    Ask(u32),
    /// Ask no longer, and answer [`Written::NotConfirmed`].
    Withdraw,
}

#[derive(Clone, Copy, Debug)]
struct Proposal {
    settings: Settings,
    signature: Signature,
}

/// The link's part: it holds what was offered until the button has decided.
#[derive(Clone, Copy, Debug, Default)]
pub struct SettingsGate {
    proposal: Option<Proposal>,
    number: u32,
}

impl SettingsGate {
    /// What follows from `offered` settings, on a device with those `in_force`. An offer that is
    /// repeated while the lamp asks for it changes nothing.
    pub fn offer(
        &mut self,
        in_force: &SettingsValues,
        offered: SettingsValues,
        signature: Signature,
        is_armed: bool,
    ) -> Decision {
        let Ok(settings) = Settings::new(offered) else {
            return Decision::Answer(Written::Invalid);
        };
        if is_armed {
            return Decision::Answer(Written::Armed);
        }
        match &self.proposal {
            Some(asked) if agree(asked.settings.values(), &offered, true) => {
                Decision::Answer(Written::AwaitsButton)
            }
            Some(_) => {
                self.proposal = None;
                Decision::Withdraw
            }
            None if agree(in_force, &offered, false) => Decision::Store(
                settings,
                Signature {
                    is_confirmed: false,
                    ..signature
                },
            ),
            None => {
                self.number = self.number.wrapping_add(1);
                let signature = Signature {
                    is_confirmed: true,
                    ..signature
                };
                self.proposal = Some(Proposal {
                    settings,
                    signature,
                });
                Decision::Ask(self.number)
            }
        }
    }

    /// Drops the proposal, which could not be asked for.
    pub fn forget(&mut self) {
        self.proposal = None;
    }

    /// What follows from the button's verdict; nothing if it is about an earlier proposal.
    pub fn decide(&mut self, verdict: Verdict) -> Option<Decision> {
        if verdict.number != self.number {
            return None;
        }
        let Proposal {
            settings,
            signature,
        } = self.proposal.take()?;
        Some(if verdict.is_confirmed {
            Decision::Store(settings, signature)
        } else {
            Decision::Answer(Written::NotConfirmed)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::LIMITS;
    use crate::limits::tests::changed;

    fn reference() -> SettingsValues {
        SettingsValues::reference()
    }

    fn faster() -> SettingsValues {
        SettingsValues {
            reference_speed_m_per_s_max: 1.0,
            ..reference()
        }
    }

    fn offer(gate: &mut SettingsGate, offered: SettingsValues) -> Decision {
        gate.offer(&reference(), offered, Signature::default(), false)
    }

    /// The verdict on a button that is pressed as in `pressed`: ticks, and whether.
    fn verdict(asked: &mut Confirmation, pressed: &[(u16, bool)]) -> Option<(u16, Verdict)> {
        let ticks = pressed
            .iter()
            .flat_map(|(ticks, pressed)| (0..*ticks).map(|_| *pressed));
        ticks.zip(1..).find_map(|(is_pressed, tick)| {
            asked.tick(is_pressed, false).map(|verdict| (tick, verdict))
        })
    }

    fn asking() -> Confirmation {
        let mut asked = Confirmation::default();
        asked.propose(Some(1));
        asked
    }

    #[test]
    fn each_setting_of_the_safety_block_waits_for_the_button_and_each_other_does_not() {
        for limit in LIMITS {
            let decision = offer(&mut SettingsGate::default(), changed(limit));
            let asks = matches!(decision, Decision::Ask(1));
            let stores = matches!(decision, Decision::Store(..));
            let expected = (limit.is_safety, !limit.is_safety);
            assert_eq!((asks, stores), expected, "{}", limit.name);
        }
    }

    #[test]
    fn held_button_confirms_what_was_offered() {
        let mut gate = SettingsGate::default();
        assert_eq!(offer(&mut gate, faster()), Decision::Ask(1));
        let repeated = Decision::Answer(Written::AwaitsButton);
        assert_eq!(offer(&mut gate, faster()), repeated);
        let mut asked = asking();
        let (tick, confirmed) = verdict(&mut asked, &[(10, false), (300, true)]).unwrap();
        assert_eq!((tick, confirmed.is_confirmed), (10 + HELD_TICKS, true));
        let Some(Decision::Store(stored, signature)) = gate.decide(confirmed) else {
            panic!("expected to store")
        };
        assert_eq!((*stored.values(), signature.is_confirmed), (faster(), true));
        assert_eq!(gate.decide(confirmed), None, "once");
    }

    #[test]
    fn button_that_is_stuck_or_short_or_late_does_not_confirm() {
        for (pressed, after) in [
            (&[(10_000, true)][..], ASKED_TICKS),
            (
                &[(5, false), (HELD_TICKS - 1, true), (9, false)],
                5 + HELD_TICKS,
            ),
            (&[(10_000, false)], ASKED_TICKS),
            (&[(ASKED_TICKS - 50, false), (400, true)], ASKED_TICKS),
        ] {
            let (tick, seen) = verdict(&mut asking(), pressed).unwrap();
            assert_eq!((tick, seen.is_confirmed), (after, false), "{pressed:?}");
            let mut gate = SettingsGate::default();
            offer(&mut gate, faster());
            let refused = Decision::Answer(Written::NotConfirmed);
            assert_eq!(gate.decide(seen), Some(refused));
        }
    }

    #[test]
    fn device_that_arms_ends_the_question() {
        let mut asked = asking();
        let seen = asked.tick(false, true).unwrap();
        assert!(!seen.is_confirmed && !asked.is_asking());
        let mut gate = SettingsGate::default();
        let armed = gate.offer(&reference(), faster(), Signature::default(), true);
        assert_eq!(armed, Decision::Answer(Written::Armed));
    }

    /// What another program sends while a person holds the button is not what is stored.
    #[test]
    fn another_offer_meanwhile_ends_both() {
        let mut gate = SettingsGate::default();
        offer(&mut gate, faster());
        let other = SettingsValues {
            vent_rate_pa_per_s: 1e6,
            ..reference()
        };
        assert_eq!(offer(&mut gate, other), Decision::Withdraw);
        let late = Verdict {
            number: 1,
            is_confirmed: true,
        };
        assert_eq!(gate.decide(late), None);
        assert_eq!(offer(&mut gate, other), Decision::Ask(2));
        assert_eq!(gate.decide(late), None, "of the first proposal");
        // Also settings outside the block are not stored while the lamp asks for others.
        let mut tuned = reference();
        tuned.compensation.friction_n = 1.0;
        assert_eq!(offer(&mut gate, tuned), Decision::Withdraw);
    }

    #[test]
    fn signature_tells_whether_the_device_has_confirmed() {
        let forged = Signature {
            is_confirmed: true,
            ..Signature::default()
        };
        let mut tuned = reference();
        tuned.compensation.friction_n = 1.0;
        let mut gate = SettingsGate::default();
        let decision = gate.offer(&reference(), tuned, forged, false);
        let Decision::Store(_, signature) = decision else {
            panic!("expected to store, found {decision:?}")
        };
        assert!(!signature.is_confirmed);
    }
}
