//! Reports of results: a self-contained `report.html`, and the same text for a terminal.
//!
//! The page needs no network. Its plots use uPlot (assets/, MIT): drag to zoom, double-click to
//! reset the zoom, hover for values; plots of one `sync` group share cursor and zoom.

use serde::Serialize;
use std::fmt::Write;

const STYLE: &str = include_str!("../../assets/report.css");
const SCRIPT: &str = include_str!("../../assets/report.js");
const PLOT_STYLE: &str = include_str!("../../assets/uPlot.min.css");
const PLOT_SCRIPT: &str = include_str!("../../assets/uPlot.iife.min.js");

/// Number of points of a decimated line, more than the columns of a screen.
const POINTS_MAX: usize = 4000;

/// Number of sections from which a report has contents.
const CONTENTS_MIN: usize = 3;

/// Significant digits of a plotted number, finer than a pixel at any practical zoom.
const DIGITS: usize = 6;

/// A report.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Its title.
    pub title: String,
    /// The results, one sentence each; the first is the headline.
    pub verdict: Vec<String>,
    /// The sections, in reading order.
    pub sections: Vec<Section>,
    /// Commands that reproduce the report.
    pub repeat: Vec<String>,
}

/// A section with a heading.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// Its heading.
    pub heading: String,
    /// Paragraphs.
    pub text: Vec<String>,
    /// Tables, before the plots.
    pub tables: Vec<Table>,
    /// Plots.
    pub plots: Vec<Plot>,
    /// Text of a file, shown verbatim at the end; empty if there is none.
    pub code: String,
}

/// A table of text cells.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Its caption.
    pub caption: String,
    /// Column headings.
    pub columns: Vec<String>,
    /// Rows with one cell per column.
    pub rows: Vec<Vec<String>>,
}

/// An axis.
#[derive(Clone, Debug, Serialize)]
pub struct Axis {
    /// Name of the quantity.
    pub label: String,
    /// The displayed unit; may be empty.
    pub unit: String,
    /// Ratio of the displayed value to the value in SI units.
    pub factor: f64,
    /// Whether it is logarithmic.
    pub log: bool,
    /// Names in place of numbers, each at its value in SI units.
    pub names: Vec<(f64, &'static str)>,
}

impl Axis {
    /// A linear axis in SI units times `factor`.
    pub fn new(label: &str, unit: &str, factor: f64) -> Axis {
        Axis {
            label: label.into(),
            unit: unit.into(),
            factor,
            log: false,
            names: Vec::new(),
        }
    }

    /// The same axis, logarithmic.
    pub fn log(self) -> Axis {
        Axis { log: true, ..self }
    }

    /// The same axis with names in place of numbers.
    pub fn named(self, names: Vec<(f64, &'static str)>) -> Axis {
        Axis { names, ..self }
    }
}

/// What a line shows; it has the same colour in all plots of all reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// A measurement.
    Measured,
    /// The simulation with the nominal or the given rig, or its residual.
    Nominal,
    /// The simulation with the fitted rig, or its residual.
    Fitted,
    /// What the sensor reads if nothing else differs.
    Noise,
}

/// A line of a plot.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Abscissae in SI units, rising.
    #[serde(serialize_with = "numbers")]
    pub x: Vec<f64>,
    /// Ordinates in SI units; a NaN is a gap.
    #[serde(serialize_with = "numbers")]
    pub y: Vec<f64>,
    /// Whether it is dashed, as references and models are.
    pub dashed: bool,
    /// What it shows; a line without a role is coloured by its place in the plot.
    pub role: Option<Role>,
    /// Half of the width of a band about it, in SI units; 0 if it has none.
    pub band: f64,
    /// Whether its points are not joined.
    pub points: bool,
}

impl Series {
    /// A solid line.
    pub fn new(name: &str, x: Vec<f64>, y: Vec<f64>) -> Series {
        Series {
            name: name.into(),
            x,
            y,
            dashed: false,
            role: None,
            band: 0.0,
            points: false,
        }
    }

    /// A decimated line: of each interval the lowest and the highest point.
    pub fn thinned(name: &str, x: &[f64], y: &[f64]) -> Series {
        let stretch = (2 * y.len()).div_ceil(POINTS_MAX).max(1);
        if y.len() <= POINTS_MAX {
            return Series::new(name, x.to_vec(), y.to_vec());
        }
        let mut thinned = Series::new(name, Vec::new(), Vec::new());
        for (x, y) in x.chunks(stretch).zip(y.chunks(stretch)) {
            let by_value = |a: &usize, b: &usize| y[*a].total_cmp(&y[*b]);
            let low = (0..y.len()).min_by(by_value).unwrap_or(0);
            let high = (0..y.len()).max_by(by_value).unwrap_or(0);
            for place in [low.min(high), low.max(high)] {
                thinned.x.push(x[place]);
                thinned.y.push(y[place]);
            }
        }
        thinned
    }

    /// The same line with a role.
    pub fn role(self, role: Role) -> Series {
        Series {
            role: Some(role),
            ..self
        }
    }

    /// The same line in a band of ± `half_width`.
    pub fn band(self, half_width: f64) -> Series {
        Series {
            band: half_width,
            ..self
        }
    }

    /// The same points, not joined.
    pub fn points(self) -> Series {
        Series {
            points: true,
            ..self
        }
    }

    /// The same line, dashed.
    pub fn dashed(self) -> Series {
        Series {
            dashed: true,
            ..self
        }
    }
}

/// A horizontal or vertical line across a plot.
#[derive(Clone, Debug, Serialize)]
pub struct Marker {
    /// Whether it is vertical, at an abscissa, or horizontal, at an ordinate.
    pub vertical: bool,
    /// The abscissa or ordinate in SI units.
    pub value: f64,
    /// Its label.
    pub label: String,
}

/// A plot.
#[derive(Clone, Debug, Serialize)]
pub struct Plot {
    /// Its title.
    pub title: String,
    /// Its caption.
    pub caption: String,
    /// Abscissa.
    pub x: Axis,
    /// Ordinate.
    pub y: Axis,
    /// Lines.
    pub series: Vec<Series>,
    /// Markers.
    pub markers: Vec<Marker>,
    /// Name of the group of plots that share cursor and zoom.
    pub sync: Option<String>,
}

/// Writes numbers with the visible digits, and null for NaN and infinity.
fn numbers<S: serde::Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(values.iter().map(|value| {
        let rounded = format!("{value:.*e}", DIGITS - 1).parse::<f64>();
        rounded.ok().filter(|value| value.is_finite())
    }))
}

/// `text` escaped for HTML.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            other => escaped.push(other),
        }
    }
    escaped
}

/// A cell or sentence escaped for HTML, with no line break between a number and its unit.
fn cell(text: &str) -> String {
    let mut cell = String::with_capacity(text.len());
    let mut rest = text.chars().peekable();
    while let Some(character) = rest.next() {
        let after_digit = cell.ends_with(|last: char| last.is_ascii_digit());
        let before_unit = rest
            .peek()
            .is_some_and(|next| next.is_alphabetic() || *next == '%');
        if character == ' ' && after_digit && before_unit {
            cell.push('\u{a0}');
        } else {
            cell.push(character);
        }
    }
    escaped(&cell)
}

/// A sentence escaped for HTML, with what stands between backticks as code.
fn sentence(text: &str) -> String {
    let html = cell(text);
    if !html.matches('`').count().is_multiple_of(2) {
        return html;
    }
    let parts = html
        .split('`')
        .enumerate()
        .map(|(place, part)| match place % 2 {
            0 => part.to_owned(),
            _ => format!("<code>{part}</code>"),
        });
    parts.collect()
}

impl Report {
    /// The report as one HTML file.
    pub fn to_html(&self) -> String {
        let mut body = String::new();
        let mut plots = Vec::new();
        // Writing to a string cannot fail.
        let _ = self.write_body(&mut body, &mut plots);
        // In a script only "</" could end the data.
        let data = serde_json::to_string(&plots)
            .unwrap_or_default()
            .replace("</", "<\\/");
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <title>{}</title>\n<style>{PLOT_STYLE}\n{STYLE}</style></head>\n\
             <body><main>{body}</main>\n<script>{PLOT_SCRIPT}</script>\n\
             <script id=\"plots\" type=\"application/json\">{data}</script>\n\
             <script>{SCRIPT}</script></body></html>\n",
            escaped(&self.title)
        )
    }

    fn write_body<'a>(&'a self, html: &mut String, plots: &mut Vec<&'a Plot>) -> std::fmt::Result {
        writeln!(html, "<header><h1>{}</h1>", escaped(&self.title))?;
        for (number, own) in self.verdict.iter().enumerate() {
            let class = if number == 0 { "headline" } else { "verdict" };
            writeln!(html, "<p class=\"{class}\">{}</p>", sentence(own))?;
        }
        writeln!(html, "</header>")?;
        self.write_contents(html)?;
        for (number, section) in self.sections.iter().enumerate() {
            let heading = escaped(&section.heading);
            writeln!(html, "<section id=\"s{number}\"><h2>{heading}</h2>")?;
            for paragraph in &section.text {
                writeln!(html, "<p>{}</p>", sentence(paragraph))?;
            }
            for table in &section.tables {
                table.write_html(html)?;
            }
            writeln!(html, "<div class=\"plots\">")?;
            for plot in &section.plots {
                let (title, caption) = (escaped(&plot.title), escaped(&plot.caption));
                writeln!(
                    html,
                    "<figure><h3>{title}</h3><div class=\"plot\" data-plot=\"{}\" role=\"img\" \
                     aria-label=\"{title}: {caption}\"></div><figcaption>{caption}</figcaption>\
                     </figure>",
                    plots.len()
                )?;
                plots.push(plot);
            }
            writeln!(html, "</div>")?;
            if !section.code.is_empty() {
                writeln!(html, "<pre><code>{}</code></pre>", escaped(&section.code))?;
            }
            writeln!(html, "</section>")?;
        }
        writeln!(html, "<footer><h2>How to repeat</h2>")?;
        for command in &self.repeat {
            writeln!(html, "<pre><code>{}</code></pre>", escaped(command))?;
        }
        writeln!(html, "</footer>")
    }

    /// The sections, if there are several, and how to use the plots.
    fn write_contents(&self, html: &mut String) -> std::fmt::Result {
        if self.sections.len() >= CONTENTS_MIN {
            writeln!(html, "<nav aria-label=\"Contents\"><ol>")?;
            for (number, section) in self.sections.iter().enumerate() {
                let heading = escaped(&section.heading);
                writeln!(html, "<li><a href=\"#s{number}\">{heading}</a></li>")?;
            }
            writeln!(html, "</ol></nav>")?;
        }
        if self
            .sections
            .iter()
            .any(|section| !section.plots.is_empty())
        {
            writeln!(
                html,
                "<p class=\"hint\">In the plots: point or tap for values, drag to zoom, \
                 double-click to see all again; a name in the legend hides its line.</p>"
            )?;
        }
        Ok(())
    }

    /// Text and tables, for a terminal.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        let _ = self.write_text(&mut text);
        text
    }

    fn write_text(&self, text: &mut String) -> std::fmt::Result {
        writeln!(text, "{}\n", self.title)?;
        for sentence in &self.verdict {
            writeln!(text, "{sentence}")?;
        }
        for section in self
            .sections
            .iter()
            .filter(|section| !section.tables.is_empty())
        {
            writeln!(text, "\n{}", section.heading)?;
            for table in &section.tables {
                table.write_text(text)?;
            }
        }
        Ok(())
    }
}

impl Table {
    fn write_html(&self, html: &mut String) -> std::fmt::Result {
        writeln!(
            html,
            "<div class=\"table\"><table><caption>{}</caption>",
            escaped(&self.caption)
        )?;
        write!(html, "<thead><tr>")?;
        for column in &self.columns {
            write!(html, "<th scope=\"col\">{}</th>", escaped(column))?;
        }
        writeln!(html, "</tr></thead><tbody>")?;
        for row in &self.rows {
            write!(html, "<tr>")?;
            for (number, text) in row.iter().enumerate() {
                let (tag, scope) = if number == 0 {
                    ("th", " scope=\"row\"")
                } else {
                    ("td", "")
                };
                write!(html, "<{tag}{scope}>{}</{tag}>", cell(text))?;
            }
            writeln!(html, "</tr>")?;
        }
        writeln!(html, "</tbody></table></div>")
    }

    fn write_text(&self, text: &mut String) -> std::fmt::Result {
        let rows = std::iter::once(&self.columns).chain(&self.rows);
        let width = |column: usize| {
            let cells = rows.clone().filter_map(|row| row.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        for row in rows.clone() {
            let cells = row.iter().zip(&widths);
            let padded: Vec<String> = cells
                .map(|(cell, width)| format!("{cell:<width$}"))
                .collect();
            writeln!(text, "  {}", padded.join("  ").trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Report {
        Report {
            title: "a <b> & \"c\"".into(),
            verdict: vec!["</script><script>alert(1)</script>".into()],
            sections: vec![Section {
                heading: "h".into(),
                plots: vec![Plot {
                    title: "</script>".into(),
                    caption: "c".into(),
                    x: Axis::new("time", "s", 1.0),
                    y: Axis::new("force", "N", 1.0),
                    series: vec![Series::new("F", vec![0.0, 1.0], vec![1.0 / 3.0, f64::NAN])],
                    markers: Vec::new(),
                    sync: None,
                }],
                ..Section::default()
            }],
            repeat: vec!["hil-sim".into()],
        }
    }

    #[test]
    fn text_is_escaped() {
        let html = sample().to_html();
        // The report has three scripts; the text must not close one.
        assert_eq!(html.matches("</script>").count(), 3);
        assert!(html.contains("&lt;/script&gt;&lt;script&gt;alert(1)"));
        assert!(html.contains("a &lt;b&gt; &amp; &quot;c&quot;"));
    }

    #[test]
    fn report_needs_no_network() {
        let mut report = sample();
        report.sections = vec![report.sections[0].clone(); CONTENTS_MIN];
        // Contents lead to places of the page itself.
        let html = report.to_html();
        assert!(html.contains("<a href=\"#s2\">"));
        let html = html.replace(" href=\"#", "");
        for fetched in [
            " src=",
            " href=",
            "@import",
            "url(",
            "fetch(",
            "XMLHttpRequest",
        ] {
            assert!(!html.contains(fetched), "{fetched}");
        }
    }

    #[test]
    fn numbers_are_short_and_gaps_are_null() {
        assert!(sample().to_html().contains("\"y\":[0.333333,null]"));
    }

    #[test]
    fn no_line_break_separates_a_number_from_its_unit() {
        assert_eq!(cell("4.00 Hz"), "4.00\u{a0}Hz");
        assert_eq!(cell("57 %"), "57\u{a0}%");
        assert_eq!(cell("valve A: 3 < 4"), "valve A: 3 &lt; 4");
    }

    #[test]
    fn commands_in_sentences_are_code() {
        assert_eq!(sentence("(`a < b`)"), "(<code>a &lt; b</code>)");
        assert_eq!(sentence("a ` b"), "a ` b");
    }

    #[test]
    fn columns_of_tables_are_aligned_in_text() {
        let table = Table {
            caption: String::new(),
            columns: vec!["ω₂".into(), "unit".into()],
            rows: vec![vec!["25.13".into(), "rad/s".into()]],
        };
        let mut text = String::new();
        table.write_text(&mut text).expect("memory");
        assert_eq!(text, "  ω₂     unit\n  25.13  rad/s\n");
    }
}
