//! Simulates a run and writes its record.

use std::collections::VecDeque;

use rand_pcg::Pcg64;

use super::drive::Run;
use super::shape::normal;
use crate::hidden::{Hidden, Moment, Reading};
use crate::machine::Machine;
use crate::record::Sensors;
use crate::rig::Rig;

/// Rest before each run, in which the filled muscle reaches its steady state.
const REST_S: f64 = 6.0;

/// The shut-off valve, implemented as an effect before all others.
struct ShutOffValve<'a>(&'a Run);

impl Hidden for ShutOffValve<'_> {
    fn commits(&self) -> bool {
        false
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let next = self
            .0
            .times_s
            .partition_point(|time_s| *time_s <= now.time_s);
        let shut = self.0.shut.get(next.saturating_sub(1));
        if shut.copied().unwrap_or(false) {
            0.0
        } else {
            flow
        }
    }
}

/// Changes of the command on their way to the valve.
struct Line<'a> {
    effects: &'a [&'a dyn Hidden],
    command_pa: f64,
    /// Times and changes, in order.
    coming: VecDeque<(f64, f64)>,
}

impl Line<'_> {
    fn send(&mut self, time_s: f64, change_pa: f64) {
        if change_pa == 0.0 {
            return;
        }
        let mut parts = vec![(time_s, 1.0)];
        for effect in self.effects {
            let late = parts.iter().flat_map(|&(sent_s, share)| {
                let arrivals = effect.arrivals(sent_s).into_iter();
                arrivals.map(move |(time_s, part)| (time_s, share * part))
            });
            parts = late.collect();
        }
        for (time_s, share) in parts {
            let place = self
                .coming
                .partition_point(|(other_s, _)| *other_s <= time_s);
            self.coming.insert(place, (time_s, share * change_pa));
        }
    }

    fn receive(&mut self, time_s: f64) {
        while let Some(&(due_s, change_pa)) = self.coming.front()
            && due_s <= time_s
        {
            self.command_pa += change_pa;
            self.coming.pop_front();
        }
    }

    /// The next change before `until_s`, or that.
    fn next_s(&self, until_s: f64) -> f64 {
        self.coming
            .front()
            .map_or(until_s, |(due_s, _)| due_s.min(until_s))
    }
}

impl Run {
    /// Readings of noiseless sensors at the record's rows. With a finger the reference is computed
    /// during the simulation; later simulations repeat it.
    pub(crate) fn simulate(&mut self, rig: &Rig, effects: &[&dyn Hidden]) -> Vec<Reading> {
        let finger = self.finger.take();
        let mut written = self.reference_pa.clone();
        let readings = self.follow(rig, effects, 1.0, |row, reading| {
            if let Some(finger) = &finger {
                written[row] = finger.reference_pa(self.times_s[row], reading);
            }
            written[row]
        });
        self.reference_pa = written;
        readings
    }

    /// The same with the references as they are.
    pub(crate) fn repeat(&self, rig: &Rig, effects: &[&dyn Hidden]) -> Vec<Reading> {
        self.repeat_within(rig, effects, 1.0)
    }

    /// The same with errors of integration `tolerance` times as large as usual.
    pub(crate) fn repeat_within(
        &self,
        rig: &Rig,
        effects: &[&dyn Hidden],
        tolerance: f64,
    ) -> Vec<Reading> {
        self.follow(rig, effects, tolerance, |row, _| self.reference_pa[row])
    }

    fn follow(
        &self,
        rig: &Rig,
        effects: &[&dyn Hidden],
        tolerance: f64,
        mut reference_pa: impl FnMut(usize, &Reading) -> f64,
    ) -> Vec<Reading> {
        let shut_off = ShutOffValve(self);
        let mut parts: Vec<&dyn Hidden> = Vec::new();
        if !self.shut.is_empty() {
            parts.push(&shut_off);
        }
        parts.extend(effects);
        let start_s = self.times_s[0];
        let start_pa = self.reference_pa[0];
        let mut machine = Machine::at_rest(rig, &parts, start_s - REST_S, start_pa);
        machine.set_tolerance(tolerance);
        machine.advance(start_s, start_pa);
        machine.settle();
        let mut line = Line {
            effects,
            command_pa: start_pa,
            coming: VecDeque::new(),
        };
        let mut sent_pa = start_pa;
        let mut readings = Vec::with_capacity(self.times_s.len() - self.unrecorded);
        for (row, &time_s) in self.times_s.iter().enumerate() {
            let reading = machine.reading();
            if row >= self.unrecorded {
                readings.push(reading);
            }
            let next_pa = reference_pa(row, &reading);
            line.send(time_s, next_pa - sent_pa);
            sent_pa = next_pa;
            let Some(&until_s) = self.times_s.get(row + 1) else {
                break;
            };
            let mut now_s = time_s;
            while now_s < until_s {
                line.receive(now_s);
                now_s = line.next_s(until_s);
                machine.advance(now_s, line.command_pa);
            }
        }
        readings
    }

    /// The record as text, with noise.
    pub(crate) fn csv(
        &self,
        readings: &[Reading],
        sensors: &Sensors,
        zeros: &Reading,
        with_force: bool,
        rng: &mut Pcg64,
    ) -> String {
        use std::fmt::Write as _;
        let mut text = String::from("time_s,pressure_ref_pa,pressure_pa,contraction");
        if with_force {
            text += ",force_n";
        }
        let shut = self.shut.get(self.unrecorded..).unwrap_or_default();
        if !shut.is_empty() {
            text += ",valve_open";
        }
        text.push('\n');
        let rows = self.times_s[self.unrecorded..].iter();
        let rows = rows.zip(&self.reference_pa[self.unrecorded..]);
        for (i, ((time_s, reference_pa), reading)) in rows.zip(readings).enumerate() {
            let pressure_pa = sensors
                .pressure_pa
                .sense(reading.pressure_pa + zeros.pressure_pa, rng);
            let contraction = sensors
                .contraction
                .sense(reading.contraction + zeros.contraction, rng);
            // drawn in any case, so that the same case without force has the same noise
            let force_n = sensors.force_n.sense(reading.force_n + zeros.force_n, rng);
            let _ = write!(
                text,
                "{time_s:.6},{reference_pa:.0},{pressure_pa:.2},{contraction:.7}"
            );
            if with_force {
                let _ = write!(text, ",{force_n:.3}");
            }
            if let Some(shut) = shut.get(i) {
                let _ = write!(text, ",{}", u8::from(!shut));
            }
            text.push('\n');
        }
        text
    }
}

/// Error of a sensor's zero that was set to the mean of `samples` readings at rest.
pub(crate) fn zero(noise: f64, samples: f64, rng: &mut Pcg64) -> f64 {
    noise / samples.sqrt() * normal(rng)
}
