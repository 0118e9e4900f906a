//! The report in Chromium, which is controlled over its DevTools protocol.
//!
//! The tests need Chromium and are therefore ignored by default:
//! `cargo test --test report_in_browser -- --ignored`.

use hil_sim::bench::closed_loop::Run;
use hil_sim::design::report::{Question, design_report};
use hil_sim::identify::diagnosis::{Diagnosed, Options, diagnose};
use hil_sim::identify::report::report as diagnosis_report;
use hil_sim::identify::simulate::simulate;
use hil_sim::paper::paper;
use hil_sim::record::{CONTRACTION, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::report::{Plot, Report, Role, Series};
use hil_sim::rig::Rig;
use muscle_plant::effects::Catalogue;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

/// The command to repeat the report, with what HTML and shells escape.
const COMMAND: &str = "hil-sim diagnose --rig 'my rig.toml' --out <out>";
/// Timeout of every operation of the browser.
const PATIENCE: Duration = Duration::from_secs(60);
/// Contrast that WCAG 2 requires for text, and for the lines of a plot.
const TEXT_CONTRAST: f64 = 4.5;
const LINE_CONTRAST: f64 = 3.0;

/// Scripts that several tests use.
const HELPERS: &str = r#"
const pen = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
const pixels = (canvas) => {
  [pen.canvas.width, pen.canvas.height] = [canvas.width, canvas.height];
  pen.drawImage(canvas, 0, 0);
  return pen.getImageData(0, 0, canvas.width, canvas.height).data;
};
const rgba = (css) => {
  pen.canvas.width = pen.canvas.height = 1;
  pen.fillStyle = css;
  pen.fillRect(0, 0, 1, 1);
  return [...pen.getImageData(0, 0, 1, 1).data];
};
const luminance = (css) => {
  const [r, g, b] = rgba(css).map((c) => c / 255)
    .map((c) => (c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const contrast = (one, other) => {
  const [dark, light] = [luminance(one), luminance(other)].sort((a, b) => a - b);
  return (light + 0.05) / (dark + 0.05);
};
const ground = (element) => {
  for (let at = element; at; at = at.parentElement) {
    const color = getComputedStyle(at).backgroundColor;
    if (rgba(color)[3] === 255) return color;
  }
  return "white";
};
// Pixels of every line's own colour.
const drawn = () => charts().map((chart) => {
  const data = pixels(chart.ctx.canvas);
  return chart.series.slice(1).map((series) => {
    const color = rgba(series.stroke(chart, chart.series.indexOf(series)));
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      count += data[i + 3] > 200 && [0, 1, 2].every((c) => Math.abs(data[i + c] - color[c]) < 24);
    }
    return count;
  });
});
"#;

/// A page in a separate browser.
struct Page {
    browser: Child,
    _profile: TempDir,
    socket: WebSocket<TcpStream>,
    session: Option<String>,
    calls: u64,
    events: Vec<Value>,
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.browser.kill();
        let _ = self.browser.wait();
    }
}

impl Page {
    /// Opens `url` in a desktop-sized window.
    fn open(chromium: &Path, url: &str) -> Page {
        let profile = TempDir::new().expect("a folder");
        let browser = Command::new(chromium)
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--no-first-run",
            ])
            .args([
                "--disable-background-networking",
                "--disable-component-update",
            ])
            .args([
                "--disable-sync",
                "--disable-quic",
                "--remote-debugging-port=0",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("Chromium starts");
        let socket = connect(profile.path());
        let mut page = Page {
            browser,
            _profile: profile,
            socket,
            session: None,
            calls: 0,
            events: Vec::new(),
        };
        let target = page.call("Target.createTarget", json!({"url": "about:blank"}));
        let attach = json!({"targetId": target["targetId"], "flatten": true});
        let attached = page.call("Target.attachToTarget", attach);
        page.session = attached["sessionId"].as_str().map(String::from);
        for domain in ["Page", "Runtime", "Log", "Network"] {
            page.call(&format!("{domain}.enable"), json!({}));
        }
        page.size(1280, false);
        page.call("Page.navigate", json!({"url": url}));
        page.wait_for("Page.loadEventFired");
        page.evaluate(HELPERS);
        page.settle();
        page
    }

    fn read(&mut self) -> Value {
        let message = self.socket.read().expect("the browser answers");
        serde_json::from_str(message.to_text().expect("text")).expect("JSON")
    }

    /// Calls a method of the protocol; events that come meanwhile are kept.
    fn call(&mut self, method: &str, params: Value) -> Value {
        self.calls += 1;
        let mut request = json!({"id": self.calls, "method": method, "params": params});
        if let Some(session) = &self.session {
            request["sessionId"] = json!(session);
        }
        let request = Message::text(request.to_string());
        self.socket.send(request).expect("the browser listens");
        loop {
            let mut answer = self.read();
            if answer["id"] == json!(self.calls) {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return answer["result"].take();
            }
            self.events.push(answer);
        }
    }

    fn wait_for(&mut self, event: &str) {
        while !self.events.iter().any(|seen| seen["method"] == event) {
            let event = self.read();
            self.events.push(event);
        }
    }

    /// The value of `script`; a promise is awaited.
    fn evaluate(&mut self, script: &str) -> Value {
        let mut answer = self.call(
            "Runtime.evaluate",
            json!({"expression": script, "returnByValue": true, "awaitPromise": true}),
        );
        let exception = &answer["exceptionDetails"];
        assert!(exception.is_null(), "{script}: {exception}");
        answer["result"]["value"].take()
    }

    fn numbers(&mut self, script: &str) -> Vec<f64> {
        let value = self.evaluate(script);
        serde_json::from_value(value).unwrap_or_else(|error| panic!("{script}: {error}"))
    }

    fn strings(&mut self, script: &str) -> Vec<String> {
        let value = self.evaluate(script);
        serde_json::from_value(value).unwrap_or_else(|error| panic!("{script}: {error}"))
    }

    /// Waits until the page is drawn.
    fn settle(&mut self) {
        self.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))");
    }

    fn size(&mut self, width: u32, phone: bool) {
        let scale = if phone { 3 } else { 1 };
        let size = json!({
            "width": width, "height": 844, "deviceScaleFactor": scale, "mobile": phone
        });
        self.call("Emulation.setDeviceMetricsOverride", size);
        self.call(
            "Emulation.setTouchEmulationEnabled",
            json!({"enabled": phone}),
        );
    }

    fn media(&mut self, media: &str, scheme: &str) {
        let features = json!([{"name": "prefers-color-scheme", "value": scheme}]);
        let emulated = json!({"media": media, "features": features});
        self.call("Emulation.setEmulatedMedia", emulated);
        self.settle();
    }

    /// Where on the screen `fraction` of the width of a plot is.
    fn point(&mut self, chart: usize, fraction: f64) -> [f64; 2] {
        let script = format!(
            "(() => {{
               const over = charts()[{chart}].over;
               over.scrollIntoView({{ block: 'center' }});
               const place = over.getBoundingClientRect();
               return [place.left + {fraction} * place.width, place.top + place.height / 2];
             }})()"
        );
        let point = self.numbers(&script).try_into().expect("x and y");
        self.settle();
        point
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], clicks: u32) {
        let event = json!({
            "type": kind, "x": x, "y": y, "button": if clicks > 0 { "left" } else { "none" },
            "buttons": u32::from(clicks > 0 && kind != "mouseReleased"), "clickCount": clicks
        });
        self.call("Input.dispatchMouseEvent", event);
    }

    fn tap(&mut self, [x, y]: [f64; 2]) {
        let touch = json!({"type": "touchStart", "touchPoints": [{"x": x, "y": y}]});
        self.call("Input.dispatchTouchEvent", touch);
        let touch = json!({"type": "touchEnd", "touchPoints": []});
        self.call("Input.dispatchTouchEvent", touch);
        self.settle();
    }

    fn legend(&mut self, chart: usize) -> Vec<String> {
        self.strings(&format!(
            "[...charts()[{chart}].root.querySelectorAll('.u-value')].map((v) => v.textContent)"
        ))
    }

    /// From and to of every plot's abscissa.
    fn ranges(&mut self) -> Vec<[f64; 2]> {
        let script = "charts().flatMap(({ scales: { x } }) => [x.min, x.max])";
        self.numbers(script).as_chunks::<2>().0.to_vec()
    }

    /// Asserts that the colour of every line of every plot is on the screen.
    fn assert_drawn(&mut self, report: &Report) {
        let counts: Vec<Vec<u32>> =
            serde_json::from_value(self.evaluate("drawn()")).expect("counts");
        let plots = plots(report);
        assert_eq!(counts.len(), plots.len());
        for (plot, counts) in plots.iter().zip(counts) {
            assert_eq!(counts.len(), plot.series.len(), "{}", plot.title);
            for (series, count) in plot.series.iter().zip(counts) {
                let (title, name) = (&plot.title, &series.name);
                // What is within the noise covers its middle; its band has a test of its own.
                if series.role == Some(Role::Noise) {
                    continue;
                }
                assert!(count >= 10, "{title}: {count} pixels of {name}");
            }
        }
    }

    /// Asserts that the page wrote nothing to the console and requested no other resource.
    fn assert_quiet(&self, url: &str) {
        for event in &self.events {
            let params = &event["params"];
            match event["method"].as_str() {
                Some("Runtime.consoleAPICalled" | "Runtime.exceptionThrown" | "Log.entryAdded") => {
                    panic!("console: {params}");
                }
                Some("Network.requestWillBeSent") => {
                    assert_eq!(params["request"]["url"], url, "a request");
                }
                Some("Network.webSocketCreated") => panic!("a request: {params}"),
                _ => {}
            }
        }
    }
}

/// The socket of the browser that writes its address into `profile`.
fn connect(profile: &Path) -> WebSocket<TcpStream> {
    let start = Instant::now();
    loop {
        let address = std::fs::read_to_string(profile.join("DevToolsActivePort"));
        if let Some((port, path)) = address
            .as_deref()
            .ok()
            .and_then(|text| text.split_once('\n'))
            && path.starts_with('/')
        {
            let stream = TcpStream::connect(format!("127.0.0.1:{port}")).expect("the browser");
            stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
            let url = format!("ws://127.0.0.1:{port}{}", path.trim());
            return tungstenite::client(url, stream).expect("a handshake").0;
        }
        assert!(start.elapsed() < PATIENCE, "Chromium does not start");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn chromium() -> PathBuf {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&path)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|file| file.is_file())
        .unwrap_or_else(|| panic!("no program of {names:?} on the PATH"))
}

/// A diagnosis with a small catalogue of a rig with a leak, and its records.
fn diagnosed() -> (Diagnosed, Vec<Record>, String) {
    let nominal = Rig::reference();
    let leak = "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 8e-9\n";
    let text = format!("{}\n{leak}", Rig::REFERENCE_TOML);
    let leaking = Rig::parse("rig.toml", &text).expect("a rig");
    let record = |seed: u64| {
        let time_s: Vec<f64> = (0..800).map(|row| f64::from(row) * 0.01).collect();
        let levels_pa = [3.0e5, 3.6e5, 2.8e5, 4.0e5];
        let level = |t: &f64| levels_pa[(t / 0.7) as usize * (seed as usize + 1) % 4];
        let mut record = Record::new(time_s.clone());
        record.set(PRESSURE_REF_PA, time_s.iter().map(level).collect());
        let first = |value: f64| {
            (0..800)
                .map(|r| if r == 0 { value } else { f64::NAN })
                .collect()
        };
        record.set(PRESSURE_PA, first(3e5));
        record.set(CONTRACTION, first(0.1));
        let mut simulated = simulate(&leaking, &record, 1e-5).expect("a run");
        let mut random = Pcg64::seed_from_u64(seed);
        for (name, noise) in [(PRESSURE_PA, 250.0), (CONTRACTION, 3e-5)] {
            let normal = Normal::new(0.0, noise).expect("a spread");
            let clean = simulated.require(name).expect("a column").to_vec();
            let read = clean.iter().map(|v| v + normal.sample(&mut random));
            simulated.set(name, read.collect());
        }
        simulated.set(
            PRESSURE_REF_PA,
            record.require(PRESSURE_REF_PA).expect("it").to_vec(),
        );
        simulated
    };
    let kept = ["leak", "payload"];
    let names = Catalogue::standard()
        .kinds()
        .map(|kind| kind.name.to_string());
    let without: Vec<String> = names.filter(|name| !kept.contains(&&name[..])).collect();
    let validate = vec![record(1)];
    let options = Options {
        without,
        ..Options::default()
    };
    let diagnosed = diagnose(&nominal, &[record(0)], &validate, &options, &|_| ());
    let diagnosed = diagnosed.expect("a diagnosis");
    let fitted = diagnosed
        .fitted
        .rewritten(Rig::REFERENCE_TOML)
        .expect("TOML");
    (diagnosed, validate, fitted)
}

/// Every kind of plot in one report: linear and logarithmic, markers both ways, lines of
/// different length.
fn report() -> &'static Report {
    static REPORT: OnceLock<Report> = OnceLock::new();
    REPORT.get_or_init(|| {
        let rig = Rig::reference();
        let question = Question {
            masses_kg: vec![8.0, 12.0, 16.0],
            ..Question::default()
        };
        let (mut report, ..) = paper(&rig, &Run::PAPER).expect("the paper");
        let (design, _) = design_report(&rig, &question).expect("a design");
        report.sections.extend(design.sections);
        let (diagnosed, validate, fitted) = diagnosed();
        let diagnosis = diagnosis_report(
            &diagnosed.diagnosis,
            &diagnosed.fitted.catalogue,
            ("Validation record", &validate, &diagnosed.free_runs),
            Some(&fitted),
        );
        assert!(
            diagnosis.verdict[0].contains("leak"),
            "{:?}",
            diagnosis.verdict
        );
        report.sections.extend(diagnosis.sections);
        report.repeat = vec![COMMAND.into()];
        report
    })
}

fn plots(report: &Report) -> Vec<&Plot> {
    let sections = report.sections.iter();
    sections.flat_map(|section| &section.plots).collect()
}

/// Runs `check` on the opened report, and asserts that the page wrote no messages.
fn in_browser(check: impl FnOnce(&mut Page, &Report)) {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("report.html");
    std::fs::write(&file, report().to_html()).expect("a file");
    let url = format!("file://{}", file.display());
    let mut page = Page::open(&chromium(), &url);
    let charts = page.numbers("[charts().length]");
    assert_eq!(charts, [plots(report()).len() as f64]);
    check(&mut page, report());
    page.assert_quiet(&url);
}

/// The number in `shown`, which must end with `unit`.
fn number(shown: &str, unit: &str) -> f64 {
    let number = match unit {
        "" => Some(shown),
        unit => shown
            .strip_suffix(unit)
            .and_then(|rest| rest.strip_suffix(' ')),
    };
    number
        .and_then(|number| number.parse().ok())
        .unwrap_or_else(|| panic!("{shown:?} is no number of {unit:?}"))
}

/// `shown` is one of the two samples of `series` next to `x`.
fn assert_sample(plot: &Plot, series: &Series, x: f64, shown: f64) {
    let mut samples: Vec<(f64, f64)> = series
        .x
        .iter()
        .copied()
        .zip(series.y.iter().copied())
        .map(|(at, y)| ((at * plot.x.factor - x).abs(), y * plot.y.factor))
        .collect();
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let close = |y: f64| (y - shown).abs() <= 1e-3 * y.abs() + 1e-9;
    let found = samples.iter().take(2).any(|(_, y)| close(*y));
    assert!(
        found,
        "{}, {}: {shown} at {x}: {:?}",
        plot.title,
        series.name,
        &samples[..2]
    );
}

#[test]
#[ignore = "needs Chromium"]
fn every_line_of_every_plot_is_drawn() {
    in_browser(|page, report| {
        page.assert_drawn(report);
    });
}

/// The files are made, and not saved: a download would be a request of the page.
#[test]
#[ignore = "needs Chromium"]
fn every_plot_can_be_saved() {
    in_browser(|page, report| {
        for (number, plot) in plots(report).iter().enumerate() {
            let text = |kind| format!("plotFile({number}, \"{kind}\").then((file) => file.text())");
            let csv = page.evaluate(&text("csv"));
            let csv = csv.as_str().expect("text");
            let mut rows = csv.lines();
            let columns = rows.next().map(|head| head.matches(',').count());
            // A name may contain commas.
            assert!(
                columns >= Some(plot.series.len()),
                "{}: {columns:?}",
                plot.title
            );
            assert!(rows.count() >= plot.series[0].x.len(), "{}", plot.title);
            let script = format!(
                "plotFile({number}, \"svg\").then((file) => file.text()).then((text) => {{
                   const svg = new DOMParser().parseFromString(text, \"image/svg+xml\");
                   return [svg.querySelectorAll(\"parsererror\").length,
                     svg.querySelectorAll(\"path\").length, text.includes(\"NaN\") ? 1 : 0];
                 }})"
            );
            let expected = [0.0, plot.series.len() as f64, 0.0];
            assert_eq!(page.numbers(&script), expected, "{}", plot.title);
            let script = format!(
                "plotFile({number}, \"png\").then((file) => createImageBitmap(file))
                   .then((image) => [image.width - charts()[{number}].ctx.canvas.width])"
            );
            assert_eq!(page.numbers(&script), [0.0], "{}", plot.title);
        }
        let buttons = page.numbers("[document.querySelectorAll(\".save button\").length]");
        assert_eq!(buttons, [3.0 * plots(report).len() as f64]);
    });
}

/// In the saved picture the band has its width, on the screen it is filled.
#[test]
#[ignore = "needs Chromium"]
fn noise_is_drawn_as_a_band() {
    in_browser(|page, report| {
        let mut filled = 0;
        for (number, plot) in plots(report).into_iter().enumerate() {
            let banded: Vec<&Series> = plot.series.iter().filter(|s| s.band > 0.0).collect();
            let widths = banded.iter().map(|s| 2.0 * s.band * plot.y.factor);
            let widths: Vec<f64> = widths.collect();
            let script = format!(
                "plotFile({number}, \"svg\").then((file) => file.text()).then((text) => {{
                   const svg = new DOMParser().parseFromString(text, \"image/svg+xml\");
                   const {{ bbox, scales: {{ y }} }} = charts()[{number}];
                   const unit = bbox.height / devicePixelRatio / (y.max - y.min);
                   return [...svg.querySelectorAll(\"polygon\")].map((band, place) => {{
                     const points = band.getAttribute(\"points\").split(\" \");
                     const ys = [points[0], points.at(-1)].map((p) => Number(p.split(\",\")[1]));
                     return ys[1] - ys[0] - {widths:?}[place] * unit;
                   }});
                 }})"
            );
            let misses_px = page.numbers(&script);
            assert_eq!(misses_px.len(), banded.len(), "{}", plot.title);
            // Corners are written to 0.01 px.
            let near = misses_px.iter().all(|miss_px| miss_px.abs() < 0.02);
            assert!(near, "{}: {misses_px:?} px", plot.title);
            let [noise] = &banded[..] else {
                continue;
            };
            let half_px = format!(
                "(({{ valToPos }}) => [valToPos(0, 'y') - valToPos({}, 'y')])(charts()[{number}])",
                noise.band * plot.y.factor
            );
            if noise.role != Some(Role::Noise) || page.numbers(&half_px)[0] < 3.0 {
                continue;
            }
            let at = 0.8 * noise.band * plot.y.factor;
            let script = format!(
                "(() => {{
                   const chart = charts()[{number}];
                   const {{ ctx: {{ canvas }}, bbox }} = chart;
                   const data = pixels(canvas);
                   const y = Math.round(chart.valToPos({at}, 'y', true));
                   return [...Array(50).keys()].map((i) => {{
                     const x = Math.round(bbox.left + (i + 0.5) / 50 * bbox.width);
                     return data[4 * (y * canvas.width + x) + 3] > 0 ? 1 : 0;
                   }});
                 }})()"
            );
            let share = page.numbers(&script).iter().sum::<f64>() / 50.0;
            assert!(share > 0.95, "{}: {share}", plot.title);
            filled += 1;
        }
        assert!(filled >= 1);
    });
}

#[test]
#[ignore = "needs Chromium"]
fn directions_are_named_points() {
    in_browser(|page, report| {
        let mut found = 0;
        for (number, plot) in plots(report).into_iter().enumerate() {
            if plot.x.names.is_empty() {
                continue;
            }
            let names = page.strings(&format!("charts()[{number}].axes[0]._values"));
            assert_eq!(
                names,
                ["extending", "at rest", "contracting"],
                "{}",
                plot.title
            );
            let joined = page.numbers(&format!(
                "charts()[{number}].series.slice(1).map((s) => s.paths() === null ? 0 : 1)"
            ));
            assert!(joined.iter().all(|line| *line == 0.0), "{}", plot.title);
            found += 1;
        }
        assert!(found >= 2);
    });
}

#[test]
#[ignore = "needs Chromium"]
fn a_line_is_hidden_by_keyboard() {
    in_browser(|page, _| {
        let shown = page.evaluate(
            "(() => {
               const name = charts()[0].root.querySelector('.u-series:not(:first-child) th');
               name.focus();
               const focused = document.activeElement === name;
               name.dispatchEvent(new KeyboardEvent('keydown', { key: 'Enter', cancelable: true }));
               return [focused, charts()[0].series[1].show];
             })()",
        );
        assert_eq!(shown, json!([true, false]));
    });
}

/// Without the clipboard, which a browser may refuse, the command is selected.
#[test]
#[ignore = "needs Chromium"]
fn the_command_to_repeat_is_copied_by_a_button() {
    in_browser(|page, _| {
        for (clipboard, expected) in [
            (
                "{ writeText: async (text) => { window.copied = text; } }",
                "Copied",
            ),
            ("undefined", "Copy"),
        ] {
            let copied = page.evaluate(&format!(
                "(async () => {{
                   Object.defineProperty(navigator, 'clipboard',
                     {{ value: {clipboard}, configurable: true }});
                   window.copied = undefined;
                   const button = document.querySelector('footer button');
                   button.textContent = 'Copy';
                   button.click();
                   await new Promise((done) => setTimeout(done, 50));
                   return [button.textContent, window.copied ?? getSelection().toString().trim()];
                 }})()"
            ));
            assert_eq!(copied, json!([expected, COMMAND]));
        }
    });
}

#[test]
#[ignore = "needs Chromium"]
fn the_contents_lead_to_every_section() {
    in_browser(|page, report| {
        let reached = page.strings(
            "[...document.querySelectorAll('nav a')].map((link) =>
               document.querySelector(link.getAttribute('href')).querySelector('h2').textContent)",
        );
        let headings = report
            .sections
            .iter()
            .map(|section| section.heading.clone());
        assert_eq!(reached, headings.collect::<Vec<_>>());
    });
}

#[test]
#[ignore = "needs Chromium"]
fn a_role_has_one_colour_in_all_plots_and_their_legends() {
    in_browser(|page, report| {
        let colors = page.evaluate(
            "charts().map((chart) => chart.series.slice(1).map((series, place) => {
               const marks = chart.root.querySelectorAll('.u-legend .u-marker');
               const legend = getComputedStyle(marks[place + 1]).borderTopColor;
               const line = series.stroke(chart, place + 1);
               return [line, legend].map((css) => rgba(css).join());
             }))",
        );
        let colors: Vec<Vec<[String; 2]>> = serde_json::from_value(colors).expect("colours");
        let mut of_roles: Vec<(Role, &String)> = Vec::new();
        for (plot, colors) in plots(report).into_iter().zip(&colors) {
            for (series, [line, legend]) in plot.series.iter().zip(colors) {
                assert_eq!(line, legend, "{}: {}", plot.title, series.name);
                of_roles.extend(series.role.map(|role| (role, line)));
            }
        }
        let color_of = |role: Role| {
            let of_role = of_roles.iter().filter(|(known, _)| *known == role);
            let colors: HashSet<&String> = of_role.map(|(_, color)| *color).collect();
            assert_eq!(colors.len(), 1, "{role:?}: {colors:?}");
            colors
        };
        let roles = [Role::Measured, Role::Nominal, Role::Fitted].map(color_of);
        assert_eq!(roles.iter().flatten().collect::<HashSet<_>>().len(), 3);
        // The gap of a rig, on the right, has the colour of the rig, on the left.
        for plot in plots(report) {
            for series in &plot.series {
                let role = match series.name.as_str() {
                    name if name.starts_with("measured") => Role::Measured,
                    "nominal rig" => Role::Nominal,
                    "fitted rig" => Role::Fitted,
                    _ => continue,
                };
                assert_eq!(series.role, Some(role), "{}", plot.title);
            }
        }
    });
}

#[test]
#[ignore = "needs Chromium"]
fn hovering_shows_each_value_with_its_unit() {
    in_browser(|page, report| {
        for (chart, plot) in plots(report).into_iter().enumerate() {
            let point = page.point(chart, 0.5);
            page.mouse("mouseMoved", point, 0);
            page.settle();
            let legend = page.legend(chart);
            assert_eq!(legend.len(), 1 + plot.series.len(), "{}", plot.title);
            let mut names = plot.x.names.iter();
            let x = match names.find(|(_, name)| *name == legend[0]) {
                Some((value, _)) => value * plot.x.factor,
                None => number(&legend[0], &plot.x.unit),
            };
            for (series, shown) in plot.series.iter().zip(&legend[1..]) {
                assert_sample(plot, series, x, number(shown, &plot.y.unit));
            }
        }
    });
}

#[test]
#[ignore = "needs Chromium"]
fn dragging_zooms_the_whole_group_and_a_double_click_shows_all() {
    in_browser(|page, report| {
        let plots = plots(report);
        let before = page.ranges();
        for (chart, plot) in plots.iter().enumerate() {
            let [from, to] = [0.3, 0.6].map(|fraction| page.point(chart, fraction));
            let over = format!("charts()[{chart}].over.clientWidth");
            let value = |part| format!("charts()[{chart}].posToVal({part} * {over}, 'x')");
            let dragged = page.numbers(&format!("[{}, {}]", value(0.3), value(0.6)));
            page.mouse("mouseMoved", from, 0);
            page.mouse("mousePressed", from, 1);
            page.mouse("mouseMoved", to, 1);
            page.mouse("mouseReleased", to, 1);
            page.settle();
            let zoomed = page.ranges();
            let mut last = chart;
            for (number, other) in plots.iter().enumerate() {
                let together = number == chart || (plot.sync.is_some() && plot.sync == other.sync);
                if !together {
                    assert_eq!(zoomed[number], before[number], "{}", other.title);
                    continue;
                }
                last = number;
                assert_eq!(zoomed[number], zoomed[chart], "{}", other.title);
                for (is, wanted) in zoomed[number].iter().zip(&dragged) {
                    let near = (is - wanted).abs() < 0.03 * (dragged[1] - dragged[0]);
                    assert!(near, "{}: {is}, dragged to {wanted}", other.title);
                }
            }
            // Any plot of the group resets it.
            let point = page.point(last, 0.5);
            for clicks in [1, 2] {
                page.mouse("mousePressed", point, clicks);
                page.mouse("mouseReleased", point, clicks);
            }
            page.settle();
            assert_eq!(page.ranges(), before, "{}", plot.title);
        }
    });
}

#[test]
#[ignore = "needs Chromium"]
fn axes_are_aligned_and_their_numbers_are_readable() {
    in_browser(|page, _| {
        let lefts = page.numbers("charts().map((chart) => chart.bbox.left)");
        assert!(lefts.iter().all(|left| *left == lefts[0]), "{lefts:?}");
        let numbers = page.evaluate(
            "charts().flatMap((chart) => chart.axes.map((axis) => axis._values.filter(Boolean)))",
        );
        let numbers: Vec<Vec<String>> = serde_json::from_value(numbers).expect("texts");
        for axis in numbers {
            let different: HashSet<&String> = axis.iter().collect();
            assert!(axis.len() >= 2 && different.len() == axis.len(), "{axis:?}");
        }
        // Past its number, an ordinate's axis holds the tick and a gap.
        let rest = page.numbers(
            "charts().map(({ axes: [, axis] }) => {
               pen.font = axis.font[0];
               const widths = axis._values.map((number) => pen.measureText(number).width);
               return axis._size - Math.max(...widths) / devicePixelRatio;
             })",
        );
        assert!(rest.iter().all(|rest| *rest >= 17.0), "{rest:?}");
    });
}

#[test]
#[ignore = "needs Chromium"]
fn markers_are_within_the_plotted_range() {
    in_browser(|page, report| {
        let horizontal = page.ranges();
        let script = "charts().flatMap(({ scales: { y } }) => [y.min, y.max])";
        let vertical = page.numbers(script).as_chunks::<2>().0.to_vec();
        for (number, plot) in plots(report).into_iter().enumerate() {
            for marker in &plot.markers {
                let (axis, [from, to]) = match marker.vertical {
                    true => (&plot.x, horizontal[number]),
                    false => (&plot.y, vertical[number]),
                };
                let at = marker.value * axis.factor;
                assert!(from < at && at < to, "{}: {}", plot.title, marker.label);
            }
        }
    });
}

#[test]
#[ignore = "needs Chromium"]
fn a_phone_shows_the_report_without_horizontal_scrolling() {
    in_browser(|page, report| {
        page.size(390, true);
        page.settle();
        let widths = page.numbers(
            "[document.documentElement.scrollWidth,
              ...[...document.querySelectorAll('.uplot, .uplot canvas, .u-legend tr')]
                .map((part) => part.getBoundingClientRect().right)]",
        );
        assert!(widths.iter().all(|width| *width <= 390.0), "{widths:?}");
        page.assert_drawn(report);
        let point = page.point(0, 0.5);
        page.tap(point);
        assert_ne!(page.legend(0)[1], "–", "a tap shows values");
        let label = page.numbers(
            "(() => {
               const label = charts()[0].root.querySelectorAll('.u-series th')[1];
               const place = label.getBoundingClientRect();
               return [place.left + place.width / 2, place.top + place.height / 2, place.height];
             })()",
        );
        assert!(label[2] >= 24.0, "a finger needs more than {} px", label[2]);
        page.tap([label[0], label[1]]);
        assert_eq!(
            page.evaluate("charts()[0].series[1].show"),
            false,
            "a tap hides a line"
        );
    });
}

#[test]
#[ignore = "needs Chromium"]
fn text_and_lines_have_enough_contrast_in_light_and_dark() {
    in_browser(|page, report| {
        for (scheme, dark) in [("light", false), ("dark", true)] {
            page.media("screen", scheme);
            let ground = page.numbers("[luminance(ground(document.body))]")[0];
            assert_eq!(ground < 0.1, dark, "{scheme}: {ground}");
            page.assert_drawn(report);
            let pale = page.strings(&format!(
                "[...document.querySelectorAll('body *:not(script)')]
                   .filter((part) => part.checkVisibility() && [...part.childNodes]
                     .some((node) => node.nodeType === 3 && node.data.trim()))
                   .filter((part) =>
                     contrast(getComputedStyle(part).color, ground(part)) < {TEXT_CONTRAST})
                   .map((part) => part.outerHTML)"
            ));
            assert_eq!(pale, [""; 0], "{scheme}");
            let pale = page.strings(&format!(
                "charts().flatMap((chart) => {{
                   const behind = ground(chart.root);
                   const least = (parts, least) => parts
                     .map((part, i) => part.stroke(chart, i))
                     .filter((color) => contrast(color, behind) < least);
                   return [...least(chart.axes, {TEXT_CONTRAST}),
                     ...chart.series.slice(1).map((line, i) => line.stroke(chart, i + 1))
                       .filter((color) => contrast(color, behind) < {LINE_CONTRAST})];
                 }})"
            ));
            assert_eq!(pale, [""; 0], "{scheme}");
        }
    });
}

#[test]
#[ignore = "needs Chromium"]
fn the_printed_page_shows_plots_and_no_hint_for_a_mouse() {
    in_browser(|page, report| {
        let widths = page.numbers("charts().map((chart) => chart.width)");
        page.media("print", "dark");
        page.evaluate("dispatchEvent(new Event('beforeprint'))");
        page.settle();
        page.assert_drawn(report);
        assert_eq!(page.numbers("[luminance(ground(document.body))]"), [1.0]);
        let hints = page.strings(
            "[...document.querySelectorAll('.hint, .u-value')]
               .filter((part) => part.checkVisibility()).map((part) => part.outerHTML)",
        );
        assert_eq!(hints, [""; 0]);
        // 18 cm: A4 and US letter with the browsers' margins.
        let rights = page.numbers(
            "[...document.querySelectorAll('table, .uplot, .u-legend tr')]
               .map((part) => part.getBoundingClientRect().right
                 - document.querySelector('main').getBoundingClientRect().left)",
        );
        assert!(
            rights.iter().all(|right| *right <= 18.0 / 2.54 * 96.0),
            "{rights:?}"
        );
        page.evaluate("dispatchEvent(new Event('afterprint'))");
        page.media("", "light");
        assert_eq!(page.numbers("charts().map((chart) => chart.width)"), widths);
        let pdf = page.call("Page.printToPDF", json!({"printBackground": true}));
        let pdf = pdf["data"].as_str().expect("base64");
        let head = &pdf[..pdf.len().min(8)];
        assert!(head.starts_with("JVBERi"), "no PDF: {head}");
        assert!(
            pdf.len() > 8_000 * plots(report).len(),
            "{} bytes",
            pdf.len()
        );
    });
}
