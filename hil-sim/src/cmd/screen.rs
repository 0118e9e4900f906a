//! The terminal screen of an experiment with hardware in the loop.

use crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use hil_sim::bench::tick::Tick;
use hil_sim::bench::view::View;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, Paragraph};
use std::io;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Interval between two drawings.
const FRAME: Duration = Duration::from_millis(50);
/// Time without a message after which the board is reported as not responding.
const MISSED_AFTER: Duration = Duration::from_millis(500);

/// Shows `view` until `done`; a key sets `stop`.
///
/// # Errors
/// The terminal does not work.
pub fn show(view: &Mutex<View>, stop: &AtomicBool, done: &AtomicBool) -> io::Result<()> {
    let mut terminal = ratatui::try_init()?;
    let mut shown = || {
        while !done.load(Ordering::Acquire) {
            // Drawing may be slow, and the real-time loop waits for the lock.
            let snapshot = view.lock().map(|view| view.clone());
            if let Ok(snapshot) = snapshot {
                terminal.draw(|frame| draw(frame, &snapshot))?;
            }
            if event::poll(FRAME)? && is_quit(&event::read()?) {
                stop.store(true, Ordering::Relaxed);
            }
        }
        Ok(())
    };
    let result = shown();
    ratatui::restore();
    result
}

fn is_quit(event: &Event) -> bool {
    let Event::Key(key) = event else {
        return false;
    };
    let interrupts =
        key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
    key.kind == KeyEventKind::Press
        && (interrupts || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc))
}

/// Draws one frame.
pub fn draw(frame: &mut Frame, view: &View) {
    let [head, plots, log] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Fill(1),
        Constraint::Length(5),
    ])
    .areas(frame.area());
    let [curves, side] =
        Layout::horizontal([Constraint::Fill(1), Constraint::Length(30)]).areas(plots);
    let [force, pressure, contraction] = Layout::vertical([Constraint::Fill(1); 3]).areas(curves);
    let title = format!(" {}   {}   q: stop", view.run, view.board);
    let bold = Style::new().add_modifier(Modifier::BOLD);
    frame.render_widget(Line::styled(title, bold), head);
    let forces: [Curve; 2] = [
        ("F_c", Color::Yellow, |tick| {
            tick.output.reference_force_n.into()
        }),
        ("F", Color::Cyan, |tick| tick.force_n),
    ];
    plot(frame, force, view, "force [N]", &forces);
    let pressures: [Curve; 2] = [
        ("P_r", Color::Yellow, |tick| 1e-3 * tick.valve_reference.0),
        ("P", Color::Cyan, |tick| 1e-3 * tick.pressure.0),
    ];
    plot(frame, pressure, view, "pressure [kPa]", &pressures);
    let contractions: [Curve; 1] = [("ε", Color::Cyan, |tick| 100.0 * tick.contraction)];
    plot(frame, contraction, view, "contraction [%]", &contractions);
    frame.render_widget(status(view), side);
    let rows = usize::from(log.height.saturating_sub(2));
    let lines = view.log[view.log.len().saturating_sub(rows)..].iter();
    let text: Vec<Line> = lines.map(|line| Line::raw(line.as_str())).collect();
    frame.render_widget(
        Paragraph::new(text).block(Block::bordered().title("log")),
        log,
    );
}

type Curve = (&'static str, Color, fn(&Tick) -> f64);

fn plot(frame: &mut Frame, area: Rect, view: &View, title: &str, curves: &[Curve]) {
    let points: Vec<Vec<(f64, f64)>> = curves
        .iter()
        .map(|(.., value)| view.ticks.iter().map(|t| (t.time_s, value(t))).collect())
        .collect();
    let values = points.iter().flatten().map(|(_, value)| *value);
    let (low, high) = values.fold((0.0_f64, 1.0_f64), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    let mut title = vec![Span::raw(title)];
    for (name, color, _) in curves {
        title.push(Span::styled(format!("  {name}"), Style::new().fg(*color)));
    }
    let sets = curves.iter().zip(&points);
    let sets = sets.map(|((_, color, _), points)| {
        Dataset::default()
            .marker(Marker::Braille)
            .graph_type(GraphType::Line)
            .style(Style::new().fg(*color))
            .data(points)
    });
    let end_s = view.duration_s;
    let x = Axis::default()
        .bounds([0.0, end_s])
        .labels(["0".to_string(), format!("{end_s:.1} s")]);
    let y = Axis::default()
        .bounds([low, high])
        .labels([format!("{low:.0}"), format!("{high:.0}")]);
    let chart = Chart::new(sets.collect())
        .block(Block::bordered().title(Line::from(title)))
        .x_axis(x)
        .y_axis(y);
    frame.render_widget(chart, area);
}

fn status(view: &View) -> Paragraph<'_> {
    let mut lines = Vec::new();
    let mut line = |name: &str, value: String, color: Option<Color>| {
        let style = color.map_or(Style::new(), |color| Style::new().fg(color));
        lines.push(Line::from(vec![
            Span::raw(format!("{name:13}")),
            Span::styled(value, style),
        ]));
    };
    if let Some(tick) = view.ticks.last() {
        let output = &tick.output;
        line("time", format!("{:.2} s", tick.time_s), None);
        line("mode", output.mode.to_string(), Some(Color::Green));
        let fault = output.fault.map(|fault| fault.to_string());
        let color = fault.as_ref().map(|_| Color::Red);
        line("fault", fault.unwrap_or_else(|| "none".into()), color);
        line("finger", format!("{:.2} N", output.finger_force_n), None);
    }
    let silence = view.answered_at.map(|answered_at| answered_at.elapsed());
    if let Some(silence) = silence.filter(|silence| *silence > MISSED_AFTER) {
        let text = format!("for {:.0} s", silence.as_secs_f64());
        line("NO ANSWER", text, Some(Color::Red));
    }
    let report = &view.report;
    let microseconds = |cycles: u32| f64::from(cycles) / view.cycles_per_us.max(1.0);
    if let Some(timing) = view.timing {
        let now = microseconds(timing.late_cycles);
        let most = microseconds(report.late_cycles_max);
        line("tick late", format!("{now:.1}, ≤ {most:.1} µs"), None);
        let now = microseconds(timing.busy_cycles);
        let most = microseconds(report.busy_cycles_max);
        line("tick takes", format!("{now:.1}, ≤ {most:.1} µs"), None);
    }
    let mut count = |name: &str, count: u64| {
        let color = (count > 0).then_some(Color::Yellow);
        line(name, count.to_string(), color);
    };
    count("missed ticks", report.missed_ticks);
    count("restarts", report.restarts as u64);
    count("silent ticks", report.link.silent_ticks);
    count("lost frames", report.link.telemetry_lost);
    count("bad frames", report.link.frames_rejected);
    Paragraph::new(lines).block(Block::bordered().title("board"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hil_sim::bench::board_settings;
    use hil_sim::bench::closed_loop::{Run, run_in_process};
    use hil_sim::rig::Rig;
    use model_core::controller::Controller;
    use model_core::timing::Timing;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use std::time::Instant;

    #[test]
    fn shows_curves_mode_timing_and_log() {
        let rig = Rig::reference();
        let settings = board_settings::from_rig(&rig).unwrap();
        let mut controller = Controller::new(settings);
        let experiment = Run {
            duration_s: 2.5,
            ..Run::PAPER
        };
        let ticks = run_in_process(&rig, &settings, &experiment, |s| controller.tick(s));
        let mut view = View::new("a board", 180_000_000);
        view.begin("valve B", 2.5);
        view.ticks = ticks.unwrap();
        view.timing = Some(Timing::default());
        view.answered_at = Instant::now().checked_sub(Duration::from_secs(7));
        view.log(vec!["INFO mode: Ready".into()]);
        for (width, height) in [(100, 40), (40, 12), (3, 2)] {
            let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
            terminal.draw(|frame| draw(frame, &view)).unwrap();
            let text = terminal.backend().to_string();
            if width == 100 {
                for part in [
                    "F_c",
                    "pressure",
                    "contraction",
                    "Assisting",
                    "tick late",
                    "NO ANSWER",
                    "INFO",
                ] {
                    assert!(text.contains(part), "{part}:\n{text}");
                }
                assert!(text.chars().any(|c| ('\u{2801}'..'\u{28ff}').contains(&c)));
            }
        }
    }
}
