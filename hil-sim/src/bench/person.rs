//! The person: the intended motion of the finger, and the hand that presses on the lever.

use model_core::assist::Assist;
use std::ops::Range;

/// The controller has finished its self-check by this time \[s\]; a finger does not move before it.
pub const CHECKED_S: f64 = 1.0;

/// The intended path of the finger on the lever.
#[derive(Clone, Debug, PartialEq)]
pub enum Finger {
    /// Up along a half cosine, a hold, and down along another half cosine.
    Lift {
        /// Start of the lift \[s\].
        start_s: f64,
        /// Travel \[m\].
        travel_m: f64,
        /// Duration of the way up \[s\].
        rise_s: f64,
        /// Duration of the hold \[s\].
        hold_s: f64,
        /// Duration of the way down \[s\].
        lower_s: f64,
    },
    /// A recorded path: linear between its samples, constant before the first and after the last.
    Recorded {
        /// Times, rising \[s\].
        time_s: Vec<f64>,
        /// Finger displacement at these times \[m\].
        finger_m: Vec<f64>,
    },
}

impl Finger {
    /// The paper's lift: 0.12 m in 1 s, after the controller's self-check.
    pub const PAPER: Finger = Finger::Lift {
        start_s: CHECKED_S,
        travel_m: 0.12,
        rise_s: 1.0,
        hold_s: 4.0,
        lower_s: 1.5,
    };

    /// A recorded path on the run's clock. It starts at 0, or later if the finger would otherwise
    /// move before the controller's self-check is over.
    pub fn recorded(time_s: &[f64], finger_m: Vec<f64>) -> Finger {
        let Some(first_s) = time_s.first() else {
            return Finger::Recorded {
                time_s: Vec::new(),
                finger_m: Vec::new(),
            };
        };
        let still = finger_m
            .iter()
            .take_while(|displacement_m| **displacement_m == finger_m[0]);
        let rest_s = time_s[still.count() - 1] - first_s;
        let wait_s = (CHECKED_S - rest_s).max(0.0);
        Finger::Recorded {
            time_s: time_s.iter().map(|t| t - first_s + wait_s).collect(),
            finger_m,
        }
    }

    /// The time over which tracking is judged \[s\]: from the first movement to the end of the hold
    /// of a lift, or to the end of a recorded path.
    pub fn followed_s(&self) -> Range<f64> {
        match self {
            Finger::Lift {
                start_s,
                rise_s,
                hold_s,
                ..
            } => *start_s..start_s + rise_s + hold_s,
            Finger::Recorded { time_s, finger_m } => {
                let moved = finger_m
                    .iter()
                    .position(|displacement_m| *displacement_m != finger_m[0]);
                let start_s = time_s.get(moved.unwrap_or(0).saturating_sub(1)).copied();
                start_s.unwrap_or(0.0)..time_s.last().copied().unwrap_or(0.0)
            }
        }
    }

    /// Intended displacement at `time_s` \[m\].
    pub fn intended_m(&self, time_s: f64) -> f64 {
        let half_cosine =
            |share: f64| 0.5 * (1.0 - (core::f64::consts::PI * share.clamp(0.0, 1.0)).cos());
        match self {
            Finger::Lift {
                start_s,
                travel_m,
                rise_s,
                hold_s,
                lower_s,
            } => {
                let up = half_cosine((time_s - start_s) / rise_s);
                let down = half_cosine((time_s - start_s - rise_s - hold_s) / lower_s);
                travel_m * (up - down)
            }
            Finger::Recorded {
                time_s: times_s,
                finger_m,
            } => {
                let after = times_s.partition_point(|t| *t <= time_s);
                match (after.checked_sub(1), finger_m.get(after)) {
                    (None, first) => first.copied().unwrap_or(0.0),
                    (Some(last), None) => finger_m[last],
                    (Some(before), Some(next)) => {
                        let span_s = times_s[after] - times_s[before];
                        let share = (time_s - times_s[before]) / span_s;
                        finger_m[before] + share * (next - finger_m[before])
                    }
                }
            }
        }
    }
}

/// The lever and the hand on it.
pub(crate) struct Hand {
    pub(crate) assist: Assist<f64>,
    pub(crate) initial_length_m: f64,
    /// Stiffness of the arm between intended and actual finger position; may be infinite.
    pub(crate) arm_stiffness_n_per_m: f64,
}

impl Hand {
    /// Finger displacement \[m\]: the lever's spring (Eq 6) and the arm in series divide the
    /// distance between the intended position and the main lever.
    pub(crate) fn finger_m(&self, intended_m: f64, contraction: f64) -> f64 {
        if self.arm_stiffness_n_per_m.is_infinite() {
            return intended_m;
        }
        let lever_m = self.assist.lever_travel_m(self.initial_length_m) * contraction;
        let (arm, lever) = (
            self.arm_stiffness_n_per_m,
            self.assist.input_stiffness_n_per_m,
        );
        (arm * intended_m + lever * lever_m) / (arm + lever)
    }

    /// Finger force F_b \[N\], Eq 6.
    pub(crate) fn force_n(&self, finger_m: f64, contraction: f64) -> f64 {
        self.assist
            .finger_force_n(finger_m, contraction, self.initial_length_m)
    }
}
/// A simulated person beside the device, who holds the button when the lamp asks
/// ([`model_core::lamp::asks`]), to be looked at every 10 ms.
#[derive(Clone, Copy, Debug, Default)]
pub struct ButtonHolder {
    was_lit: bool,
    since_ticks: u32,
    /// Changes of the lamp in a row that were as quick as those of the question.
    quick: u32,
    holds_ticks: u32,
}

impl ButtonHolder {
    /// Whether the button is pressed in the next tick, after a tick with the lamp like that.
    pub fn presses(&mut self, is_lit: bool) -> bool {
        if self.holds_ticks > 0 {
            self.holds_ticks -= 1;
        } else if is_lit == self.was_lit {
            self.since_ticks += 1;
        } else {
            let is_quick = (4..=6).contains(&self.since_ticks);
            self.quick = if is_quick { self.quick + 1 } else { 0 };
            (self.was_lit, self.since_ticks) = (is_lit, 1);
            if self.quick == 6 {
                (self.quick, self.holds_ticks) = (0, 220);
            }
        }
        self.holds_ticks > 0
    }
}
