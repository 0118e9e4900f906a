//! The steps: what each asks, listens to and compares.

use crate::bench::error::Error;
use crate::bench::port::client::Transport;
use crate::commission::air::{
    Course, Played, SlowLift, Staircase, lifting, limited, listen, play, plugged,
};
use crate::commission::cause::{Cause, Step};
use crate::commission::curve;
use crate::commission::lift::{self, Known, Lift};
use crate::commission::person::Person;
use crate::commission::readings::{self, Readings, SECOND_TICKS};
use crate::commission::scale::{self, Line, Point};
use crate::commission::session::{Given, Seen, Session};
use crate::commission::written;
use model_core::constants::GRAVITY_M_PER_S2;
use model_core::link::Telemetry;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, AdcScale};
use model_core::supervisor::Mode;
use muscle_plant::nominal::Load;

/// Ticks after an answer that are left out: the board's filters still hold what was before.
const SETTLE_TICKS: usize = 10;
/// Ticks in which a person does something and holds it.
const ACT_TICKS: usize = 4 * SECOND_TICKS;
/// Ticks in which a leak shows.
const LEAK_TICKS: usize = 3 * SECOND_TICKS;
/// Triangles for the friction.
const CYCLES: usize = 3;

/// A number with four digits.
fn short(value: f64) -> String {
    format!(
        "{:.*}",
        (3 - value.abs().max(1e-3).log10().floor() as i32).max(0) as usize,
        value
    )
}

fn kpa(pressure_pa: f64) -> String {
    format!("{:.1} kPa", 1e-3 * pressure_pa)
}

impl<P: Transport, W: Person> Session<'_, P, W> {
    fn level(&mut self, ticks: usize) -> Result<(Readings, Vec<Telemetry>), Error> {
        let heard = listen(self.client, SETTLE_TICKS + ticks)?.split_off(SETTLE_TICKS);
        Ok((readings::readings(&heard), heard))
    }

    pub(super) fn start(&mut self, checks: bool) -> Result<Given, Error> {
        let text = match checks {
            true => "No pressure in the muscle, the weight on its stop, nobody at the lever",
            false => "Air shut, hose off the muscle, nobody at the lever",
        };
        self.wait("hands-off", text)?;
        let mut seen = Seen::new(Step::Start);
        self.identity = self.client.identity()?;
        let found = self.identity.start;
        let words = found.map_or("passed".into(), |fault| fault.to_string());
        seen.row("start-up self-test", words, "passed".into());
        seen.add(found.map(Cause::StartTest));
        let (rest, ticks) = self.level(SECOND_TICKS)?;
        let (bridge, pressure) = (&self.values.bridge, &self.values.pressure_sensor);
        for (what, level, zero) in [
            ("bridge", rest.bridge, bridge.zero_count),
            ("pressure sensor", rest.pressure, pressure.zero_count),
        ] {
            let saw = format!("{:.0} counts, noise {:.1}", level.count, level.sd);
            seen.row(what, saw, format!("about {zero:.0}"));
        }
        let missed = ticks
            .last()
            .map_or(0, |tick| tick.timing.missed_ticks_total);
        seen.row("missed ticks", missed.to_string(), "0".into());
        seen.add(readings::at_rest(&rest, &self.values));
        self.rest = rest;
        Ok((seen, self.values, self.measured.clone()))
    }

    pub(super) fn emergency_stop(&mut self) -> Result<Given, Error> {
        let mut seen = Seen::new(Step::Stop);
        let (_, free) = self.level(SECOND_TICKS)?;
        let open = readings::stop_released(&free);
        let words = |cause: Option<Cause>, good: &str| {
            cause.map_or(good, |cause| cause.words()).to_string()
        };
        seen.row("not pressed", words(open, "closed"), "closed".into());
        seen.add(open);
        if open.is_some() {
            return Ok((seen, self.values, self.measured.clone()));
        }
        self.wait(
            "stop-press",
            "Press the emergency stop, and leave it pressed",
        )?;
        let (_, pressed) = self.level(SECOND_TICKS)?;
        let cause = readings::stop_pressed(&pressed);
        let saw = words(cause, "both contacts open");
        seen.row("pressed", saw, "both contacts open".into());
        seen.add(cause);
        let pattern = match pressed
            .last()
            .map(|tick| (tick.output.mode, tick.output.fault))
        {
            Some((Mode::Ready, _)) if cause.is_none() => "two short flashes every 2 s",
            Some((Mode::Ready, _)) => "a short flash every 2 s",
            Some((Mode::SelfCheck, _)) => "5 flashes a second",
            _ => "1 to 8 flashes, then dark for a second",
        };
        let text = format!("Does the lamp show this: {pattern}? y, n");
        let shows = self.choose("lamp", &text, &["y", "n"])?;
        let saw = if shows == "y" { pattern } else { "another" };
        seen.row("lamp", saw.into(), pattern.into());
        seen.add((shows == "n").then_some(Cause::Lamp));
        self.wait("stop-release", "Release the emergency stop")?;
        let (_, free) = self.level(SECOND_TICKS)?;
        seen.add(readings::stop_released(&free));
        Ok((seen, self.values, self.measured.clone()))
    }

    pub(super) fn wiring(&mut self) -> Result<Given, Error> {
        let mut seen = Seen::new(Step::Wiring);
        let mut values = self.values;
        type Judge = fn(&readings::Movement, &SettingsValues) -> Option<Cause>;
        let acts: [(&'static str, &str, &str, Judge); 3] = [
            (
                "lever",
                "Enter, then press the lever as if to lift, with about 5 N, and hold for 4 s",
                "the bridge rises",
                readings::lever_pressed,
            ),
            (
                "lift-by-hand",
                "Enter, then lift the weight by hand by about 10 mm, and hold for 4 s",
                "the encoder counts up",
                readings::weight_lifted,
            ),
            (
                "pump",
                "Hand pump with a gauge to the hose; Enter, then pump to about 100 kPa in 4 s",
                "the pressure rises",
                readings::hose_pumped,
            ),
        ];
        for (name, text, expected, judge) in acts {
            self.choose(name, text, &[""])?;
            let (_, ticks) = self.level(ACT_TICKS)?;
            let movement = readings::movement(&self.rest, &ticks);
            seen.row(name, movement.words(), expected.into());
            let cause = judge(&movement, &self.values);
            match cause {
                Some(Cause::BridgeInverted) => values.bridge.per_count *= -1.0,
                Some(Cause::EncoderSwapped) => values.encoder_m_per_count *= -1.0,
                _ => {}
            }
            seen.add(cause);
            self.person.tell("  Let go.\n");
        }
        Ok((seen, values, self.measured.clone()))
    }

    pub(super) fn bridge(&mut self) -> Result<Given, Error> {
        self.wait("bridge-zero", "Nobody and nothing at the lever")?;
        let mut points = vec![self.bridge_point(0.0)?];
        for (name, which) in [
            ("bridge-mass-1", "a first"),
            ("bridge-mass-2", "the second"),
        ] {
            let text = format!(
                "Hang {which} weight (0.3 to 2 kg) where the finger presses, so that it pulls as \
                 if to lift, and let it come to rest. Its mass [kg]"
            );
            let mass_kg = self.number(name, &text, (0.01, 100.0))?;
            points.push(self.bridge_point(mass_kg * GRAVITY_M_PER_S2)?);
        }
        let line = scale::line(&points);
        let mut seen = Seen::new(Step::Bridge);
        self.row_of_line(&mut seen, &line, self.values.bridge, "N");
        let off = format!("{:.1} % off the line", 100.0 * line.curved);
        seen.row("points", off, "at most 2 %".into());
        seen.add(scale::bridge(&line, &self.values));
        seen.plots
            .push(written::line_plot("force", "N", &points, &line));
        let mut measured = self.measured.clone();
        measured.bridge = Some(line);
        let values = SettingsValues {
            bridge: line.scale,
            ..self.values
        };
        Ok((seen, values, measured))
    }

    fn bridge_point(&mut self, force_n: f64) -> Result<Point, Error> {
        let (now, _) = self.level(SECOND_TICKS)?;
        Ok(Point {
            level: now.bridge,
            quantity: force_n,
        })
    }

    fn row_of_line(&self, seen: &mut Seen, line: &Line, expected: AdcScale, unit: &str) {
        let scale = line.scale;
        let (zero, expected_zero) = (scale.zero_count, expected.zero_count);
        seen.row(
            "zero",
            format!("{zero:.1} counts"),
            format!("about {expected_zero:.0}"),
        );
        let per = |per_count: f32| format!("{} {unit} a count", short(per_count.into()));
        let sd = format!(
            "{} ± {:.2} %",
            per(scale.per_count),
            100.0 * line.relative_sd
        );
        seen.row("gain", sd, per(expected.per_count));
    }

    pub(super) fn pressure(&mut self) -> Result<Given, Error> {
        self.wait(
            "pressure-zero",
            "Open the hand pump: no pressure in the hose",
        )?;
        let (zero, _) = self.level(SECOND_TICKS)?;
        let text = "Pump to about half the supply, and shut the pump. The gauge's reading [Pa]";
        let gauge_pa = self.number("pressure-gauge", text, (1e3, 1e7))?;
        let (now, ticks) = self.level(LEAK_TICKS)?;
        let point = |level, quantity| Point { level, quantity };
        let points = [point(zero.pressure, 0.0), point(now.pressure, gauge_pa)];
        let mut seen = Seen::new(Step::Pressure);
        let movement = readings::movement(&zero, &ticks);
        let loss = scale::loss_per_s(zero.pressure, &ticks);
        let cause = readings::hose_pumped(&movement, &self.values);
        if cause.is_some() {
            seen.row("pump", movement.words(), "the pressure rises".into());
            seen.add(cause);
            return Ok((seen, self.values, self.measured.clone()));
        }
        let line = scale::line(&points);
        self.row_of_line(&mut seen, &line, self.values.pressure_sensor, "Pa");
        seen.row(
            "pump shut",
            format!("loses {:.1} % a second", 100.0 * loss),
            "at most 1 %".into(),
        );
        seen.add(scale::leaks(loss).then_some(Cause::Leak));
        if !scale::leaks(loss) {
            seen.add(scale::pressure(&line, &self.values));
        }
        seen.plots
            .push(written::line_plot("pressure", "Pa", &points, &line));
        let mut measured = self.measured.clone();
        measured.pressure = Some(line);
        let values = SettingsValues {
            pressure_sensor: line.scale,
            ..self.values
        };
        Ok((seen, values, measured))
    }

    pub(super) fn encoder(&mut self) -> Result<Given, Error> {
        self.wait("encoder-stop", "The weight on its stop")?;
        let (stop, _) = self.level(SECOND_TICKS)?;
        let text = "Lift the weight by hand onto a spacer of known height. Its height [m]";
        let height_m = self.number("spacer", text, (1e-3, 1.0))?;
        let (up, _) = self.level(SECOND_TICKS)?;
        self.wait(
            "encoder-home",
            "Take the spacer away: the weight on its stop",
        )?;
        let (home, _) = self.level(SECOND_TICKS)?;
        let counts = up.encoder.since(stop.encoder);
        let home = home.encoder.since(stop.encoder);
        let m_per_count = height_m / f64::from(counts);
        let mut seen = Seen::new(Step::Encoder);
        let expected_m = f64::from(self.values.encoder_m_per_count);
        let um = |metres: f64| format!("{} µm a count", short(1e6 * metres));
        seen.row(
            "spacer",
            format!("{counts} counts"),
            format!("{:.0}", height_m / expected_m),
        );
        seen.row("scale", um(m_per_count), um(expected_m));
        seen.row("back on the stop", format!("{home} counts"), "0".into());
        let values = match counts {
            0 => self.values,
            _ => SettingsValues {
                encoder_m_per_count: m_per_count as f32,
                ..self.values
            },
        };
        seen.add(match counts {
            0 => Some(Cause::EncoderSilent),
            _ => scale::encoder(m_per_count, home, &self.values),
        });
        Ok((seen, values, self.measured.clone()))
    }

    /// Plays if the board accepts the settings; none if it refuses, or the play was interrupted.
    fn play_checked(
        &mut self,
        seen: &mut Seen,
        trial: SettingsValues,
        course: &mut dyn Course,
    ) -> Result<Option<Played>, Error> {
        if let Err(error) = Settings::new(trial) {
            seen.row("settings", error.to_string(), "settings that pass".into());
            seen.add(Some(Cause::Refused));
            return Ok(None);
        }
        let played = play(self.client, (&trial, &self.old), course)?;
        let end = played
            .fault
            .map_or("none".into(), |fault| fault.to_string());
        seen.row("fault", end, "none".into());
        // A part of a play looks like a weight that does not lift.
        if played.begun && !played.finished && played.fault.is_none() {
            seen.row("play", "interrupted".into(), "to its end".into());
            seen.add(Some(Cause::Interrupted));
            return Ok(None);
        }
        Ok(Some(played))
    }

    /// Adds the board's fault, or that it did not begin, if nothing else explains the play.
    fn unexplained(seen: &mut Seen, played: &Played) {
        if !seen.causes.is_empty() {
            return;
        }
        let stopped = played
            .ticks
            .last()
            .and_then(|last| readings::stop_released(&[*last]));
        seen.add(played.fault.map(Cause::Board).or(stopped));
        if !played.begun && seen.causes.is_empty() {
            seen.add(Some(Cause::Refused));
        }
    }

    pub(super) fn valve(&mut self) -> Result<Given, Error> {
        let text = "The hose, with the pressure sensor, off the muscle and PLUGGED; the valve's \
                    24 V on; the supply still shut";
        self.wait("plug", text)?;
        let text = "Open the supply. The reading of its gauge [Pa]";
        let supply_pa = self.number("supply", text, (1e4, 2e6))?;
        let (now, _) = self.level(SECOND_TICKS)?;
        let mut seen = Seen::new(Step::Valve);
        let count = AdcCount(now.pressure.count.round() as u16);
        let rest_pa = f64::from(self.values.pressure_sensor.value(count));
        seen.row("pressure at 0 V", kpa(rest_pa), "0".into());
        seen.add(curve::at_zero(rest_pa));
        let mut values = limited(self.values, supply_pa);
        let mut measured = self.measured.clone();
        if !seen.causes.is_empty() {
            return Ok((seen, self.values, measured));
        }
        let trial = plugged(values);
        let mut course = Staircase::new(&trial);
        let Some(played) = self.play_checked(&mut seen, trial, &mut course)? else {
            return Ok((seen, self.values, measured));
        };
        let found = curve::curve(&trial, &played.ticks);
        let gain = format!("{:.3} ± {:.3}", found.gain, found.gain_sd);
        seen.row("pressure over reference", gain, "1 within 5 %".into());
        let reached = found.supply_pa.map_or("not reached".into(), kpa);
        seen.row("end of the rise", reached, kpa(supply_pa));
        if course.moved {
            seen.add(Some(Cause::HoseOnMuscle));
        } else if played.begun {
            seen.add(curve::valve(&found, supply_pa));
        }
        Self::unexplained(&mut seen, &played);
        seen.plots.push(written::curve_plot(&found));
        if found.gain > 0.0 {
            values.valve_drive.amplifier_gain *= found.gain as f32;
        }
        let supply_pa = found.supply_pa.unwrap_or(supply_pa);
        measured.curve = Some(found);
        Ok((seen, limited(values, supply_pa), measured))
    }

    fn known(&self, values: SettingsValues) -> Known {
        let sd = |key: &str| {
            let mut of_muscle = self.rig.tolerances.iter();
            let found = of_muscle.find(|own| own.section == "muscle" && own.key == key);
            found.map_or(0.0, |own| own.relative_sigma)
        };
        Known {
            values,
            muscle_sd: ["alpha_m2", "beta_m2", "gamma_n"].map(sd),
        }
    }

    pub(super) fn lift(&mut self, checks: bool) -> Result<Given, Error> {
        let mut seen = Seen::new(Step::Lift);
        let mut values = self.values;
        if !checks {
            let text = "Weigh the load. Its mass [kg]";
            values.load_kg = self.number("load", text, (0.1, 1e3))? as f32;
        }
        let text = "With the supply shut: the hose on the muscle, the weight on its stop. Then \
                    open the supply. Nobody near the weight: it will rise by some millimetres";
        self.wait("muscle-on", text)?;
        let known = self.known(lifting(values));
        let mut limit_pa = known.lifts_pa() + known.unseen_pa();
        let (found, played) = loop {
            let mut course = SlowLift::new(&known, limit_pa, 1);
            let Some(played) = self.play_checked(&mut seen, known.values, &mut course)? else {
                return Ok((seen, self.values, self.measured.clone()));
            };
            let found = lift::lift(&known, &played.ticks);
            let unmoved = played.fault.is_none() && played.begun && found.mass_kg.is_none();
            let in_order = (1.0 / 1.05..1.05).contains(&found.drive_ratio);
            let highest = limit_pa > f64::from(known.values.pressure_pa_max);
            if !unmoved || !in_order || highest || found.bottom_m < -lift::WRONG_WAY_M {
                break (found, played);
            }
            let text = format!(
                "No motion was read up to {}; expected {}. Is the weight really still on its \
                 stop, and is it free? y: try {} more, n: end the step",
                kpa(limit_pa),
                kpa(known.lifts_pa()),
                kpa(known.unseen_pa()),
            );
            if self.choose("higher", &text, &["y", "n"])? == "n" {
                break (found, played);
            }
            limit_pa += known.unseen_pa();
        };
        self.judge_lift(&mut seen, &known, &found, &played);
        let mut measured = self.measured.clone();
        measured.lift = Some(found);
        Ok((seen, values, measured))
    }

    fn judge_lift(&self, seen: &mut Seen, known: &Known, found: &Lift, played: &Played) {
        let ratio = format!("{:.3}", found.drive_ratio);
        seen.row("pressure over reference", ratio, "1 within 5 %".into());
        let travel = format!("{:.2} to {:.2} mm", 1e3 * found.bottom_m, 1e3 * found.top_m);
        seen.row(
            "travel",
            travel,
            format!("0 to {:.1} mm", 1e3 * lift::TOP_M),
        );
        let mass = found.mass_kg;
        let saw = mass.map_or("not lifted".into(), |mass| format!("{mass:.2} kg"));
        let sd_kg = known.force_sd_n(known.lifts_pa()) / GRAVITY_M_PER_S2;
        let load_kg = known.values.load_kg;
        seen.row(
            "mass by the lift",
            saw,
            format!("{load_kg:.2} kg (the muscle's constants allow ± {sd_kg:.2} kg)"),
        );
        if mass.is_some() {
            let saw = format!("{:.2}", found.travel_ratio);
            let expected = "0.75 to 1.33, less with hysteresis";
            seen.row("travel over that of Eq 1", saw, expected.into());
        }
        if played.begun {
            let curve_known = self.measured.curve.is_some();
            seen.add(lift::contradiction(known, found, curve_known));
        }
        Self::unexplained(seen, played);
        seen.plots.extend(written::lift_plots(found));
    }

    pub(super) fn friction(&mut self) -> Result<Given, Error> {
        let mut seen = Seen::new(Step::Friction);
        self.wait("again", "Nobody near the weight: it will go up and down")?;
        let known = self.known(lifting(self.values));
        let limit_pa = known.lifts_pa() + 2.0 * known.unseen_pa();
        let mut course = SlowLift::new(&known, limit_pa, CYCLES);
        let mut measured = self.measured.clone();
        let Some(played) = self.play_checked(&mut seen, known.values, &mut course)? else {
            return Ok((seen, self.values, measured));
        };
        let found = lift::lift(&known, &played.ticks);
        let Load::Weight(weight) = self.rig.nominal.load else {
            return Ok((seen, self.values, measured));
        };
        if played.begun && found.mass_kg.is_none() {
            seen.row("lift", "none".into(), "three".into());
            seen.add(Some(Cause::LoadHeavier));
        }
        let (static_n, sd_n) = found.static_friction();
        seen.row(
            "static friction",
            format!("{static_n:.1} ± {sd_n:.1} N"),
            format!("about {} N", weight.static_friction_n),
        );
        seen.row(
            "Coulomb friction",
            format!("{:.1} N", found.coulomb_n),
            format!("about {} N", weight.coulomb_friction_n),
        );
        Self::unexplained(&mut seen, &played);
        seen.plots.extend(written::lift_plots(&found));
        measured.friction = Some(found);
        Ok((seen, self.values, measured))
    }
}
