//! Timing of ticks: late and missed ones, from a free-running counter of CPU cycles.

use crate::constants::TICK_PERIOD_MS;
use core::num::NonZeroU32;
use serde::{Deserialize, Serialize};

/// When a tick began and how long the one before it took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Timing {
    /// Ticks missed since the last one.
    pub missed_ticks: u8,
    /// CPU cycles after the earliest possible start; its spread is the jitter.
    pub late_cycles: u32,
    /// CPU cycles that the last tick took.
    pub busy_cycles: u32,
    /// Ticks missed since the reset.
    pub missed_ticks_total: u32,
    /// The largest of `late_cycles` since the reset.
    pub late_cycles_max: u32,
    /// The largest of `busy_cycles` since the reset.
    pub busy_cycles_max: u32,
    /// Share of the serial link's capacity that its busier direction used in a second \[1/1000\].
    pub link_per_mille: u16,
}

/// Compares each tick with a grid of equal periods.
#[derive(Clone, Copy, Debug)]
pub struct TickClock {
    period_cycles: NonZeroU32,
    /// Where on the grid the last tick was due, and how long it took.
    due_cycles: Option<u32>,
    /// What the next tick reports, and its maxima so far.
    timing: Timing,
}

impl TickClock {
    /// A clock whose grid begins with the first tick.
    pub const fn new(period_cycles: NonZeroU32) -> TickClock {
        TickClock {
            period_cycles,
            due_cycles: None,
            timing: Timing {
                missed_ticks: 0,
                late_cycles: 0,
                busy_cycles: 0,
                missed_ticks_total: 0,
                late_cycles_max: 0,
                busy_cycles_max: 0,
                link_per_mille: 0,
            },
        }
    }

    /// A tick begins at `now_cycles`, on a counter that wraps. Gaps longer than the counter's span
    /// are reported too short.
    pub fn begin(&mut self, now_cycles: u32) -> Timing {
        let period_cycles = self.period_cycles.get();
        let Some(last_cycles) = self.due_cycles else {
            self.due_cycles = Some(now_cycles);
            return Timing::default();
        };
        let elapsed_cycles = now_cycles.wrapping_sub(last_cycles);
        // A tick that comes a little early shows that the grid was set by a late one.
        let early_cycles = period_cycles / 64;
        let periods = (elapsed_cycles.saturating_add(early_cycles) / self.period_cycles).max(1);
        let due_after_cycles = periods.saturating_mul(period_cycles);
        let late_cycles = elapsed_cycles.checked_sub(due_after_cycles);
        self.due_cycles = Some(match late_cycles {
            Some(_) => last_cycles.wrapping_add(due_after_cycles),
            None => now_cycles,
        });
        let timing = &mut self.timing;
        timing.missed_ticks = (periods - 1).min(u32::from(u8::MAX)) as u8;
        timing.missed_ticks_total = timing.missed_ticks_total.saturating_add(periods - 1);
        timing.late_cycles = late_cycles.unwrap_or(0);
        timing.late_cycles_max = timing.late_cycles_max.max(timing.late_cycles);
        *timing
    }

    /// The tick that began at `begin_cycles` ends.
    pub fn end(&mut self, begin_cycles: u32, now_cycles: u32) {
        let timing = &mut self.timing;
        timing.busy_cycles = now_cycles.wrapping_sub(begin_cycles);
        timing.busy_cycles_max = timing.busy_cycles_max.max(timing.busy_cycles);
    }
}

/// Ticks over which the link's load is taken: a second.
const LOAD_TICKS: u32 = 1_000 / TICK_PERIOD_MS;

/// Measures the load of the serial link.
#[derive(Clone, Copy, Debug)]
pub struct LinkLoad {
    bytes_per_s: NonZeroU32,
    sent: u32,
    received: u32,
    ticks: u32,
    per_mille: u16,
}

impl LinkLoad {
    /// For a link that carries so many bytes per second in each direction.
    pub const fn new(bytes_per_s: NonZeroU32) -> LinkLoad {
        LinkLoad {
            bytes_per_s,
            sent: 0,
            received: 0,
            ticks: 0,
            per_mille: 0,
        }
    }

    /// Counts bytes that are sent.
    pub fn sent(&mut self, bytes: usize) {
        self.sent = self.sent.saturating_add(bytes as u32);
    }

    /// Counts a byte that was received.
    pub fn received(&mut self) {
        self.received = self.received.saturating_add(1);
    }

    /// A tick has passed: the load of the last whole second, 0 before its end.
    pub fn tick(&mut self) -> u16 {
        self.ticks += 1;
        if self.ticks >= LOAD_TICKS {
            let busier = u64::from(self.sent.max(self.received));
            let per_mille = busier * 1_000 / u64::from(self.bytes_per_s.get());
            *self = LinkLoad {
                per_mille: per_mille.min(u64::from(u16::MAX)) as u16,
                ..LinkLoad::new(self.bytes_per_s)
            };
        }
        self.per_mille
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD: NonZeroU32 = NonZeroU32::new(1_800_000).unwrap();

    /// Timings of ticks at `times`, in cycles from the first, on a counter that starts at `from`.
    fn timings(from: u32, times: &[u64]) -> Vec<Timing> {
        let mut clock = TickClock::new(PERIOD);
        times
            .iter()
            .map(|t| clock.begin(from.wrapping_add(*t as u32)))
            .collect()
    }

    #[test]
    fn a_tick_delayed_by_seven_milliseconds_is_late_and_not_missed() {
        let seen = timings(0, &[0, 1_800_000, 4_860_000, 5_400_000, 7_200_000]);
        let late: Vec<u32> = seen.iter().map(|t| t.late_cycles).collect();
        assert_eq!(late, [0, 0, 1_260_000, 0, 0]);
        assert!(seen.iter().all(|t| t.missed_ticks == 0));
    }

    #[test]
    fn a_late_first_tick_does_not_shift_the_grid_for_good() {
        let seen = timings(0, &[20_000, 1_800_000, 3_600_005, 5_400_000]);
        let late: Vec<u32> = seen.iter().map(|t| t.late_cycles).collect();
        assert_eq!(late, [0, 0, 5, 0]);
    }

    #[test]
    fn duration_is_reported_with_the_next_tick() {
        let mut clock = TickClock::new(PERIOD);
        clock.begin(u32::MAX - 5);
        clock.end(u32::MAX - 5, 100);
        assert_eq!(clock.begin(1_800_000).busy_cycles, 106);
    }

    #[test]
    fn maxima_and_missed_ticks_are_kept_until_the_reset() {
        let mut clock = TickClock::new(PERIOD);
        let mut at = |begin: u32, busy: u32| {
            let timing = clock.begin(begin);
            clock.end(begin, begin.wrapping_add(busy));
            timing
        };
        at(0, 500);
        at(1_800_700, 900);
        at(9_000_000, 300);
        let last = at(10_800_020, 100);
        assert_eq!((last.late_cycles, last.late_cycles_max), (20, 700));
        assert_eq!((last.busy_cycles, last.busy_cycles_max), (300, 900));
        assert_eq!((last.missed_ticks, last.missed_ticks_total), (0, 3));
    }

    #[test]
    fn load_is_that_of_the_busier_direction_in_the_last_second() {
        let mut load = LinkLoad::new(NonZeroU32::new(92_160).unwrap());
        let mut second = |sent: usize, received: usize| {
            let mut seen = 0;
            for _ in 0..100 {
                load.sent(sent);
                (0..received).for_each(|_| load.received());
                seen = load.tick();
            }
            seen
        };
        assert_eq!(second(65, 10), 70);
        assert_eq!(second(65, 460), 499);
        assert_eq!(second(0, 0), 0);
    }

    proptest! {
        #[test]
        fn no_tick_is_lost_from_the_count(
            from: u32,
            gaps in prop::collection::vec((1_u64..200, 0_u64..20_000), 1..50),
        ) {
            let mut tick = 0;
            let mut times = vec![0];
            for (ticks, latency_cycles) in &gaps {
                tick += ticks;
                times.push(tick * 1_800_000 + latency_cycles);
            }
            let seen = timings(from, &times);
            let counted: u64 = seen.iter().skip(1).map(|t| 1 + u64::from(t.missed_ticks)).sum();
            prop_assert_eq!(counted, tick);
            for (timing, (_, latency_cycles)) in seen.iter().skip(1).zip(&gaps) {
                prop_assert_eq!(u64::from(timing.late_cycles), *latency_cycles);
            }
        }
    }
}
