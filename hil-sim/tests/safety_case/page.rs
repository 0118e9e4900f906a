//! The page: docs/safety-case/README.md.

use super::evidence::Results;
use super::figures::{CASES_PER_KIND, Figures, SEED, SEQUENCES};
use super::level::{level, symmetric_years, years};
use super::sequences::run::{Ran, most, tally};
use super::source::{Requirement, Source};
use hil_sim::faults::kind::KINDS;
use std::fmt::Write;

const INTRODUCTION: &str = "\
# Safety case

What is claimed about the rig beside a person, and what shows it. **This is no certificate**, and
nothing here has run on a real rig. [safety.md](../safety.md) derives the bounds and explains the
functions; this page says what is shown by what, on this commit.

The page is generated from [case.toml](case.toml), and a test fails if it is not what is
generated:

    SAFETY_CASE=write cargo test -p hil-sim --test safety_case      # writes it, after a change

Numbers are those of the simulated plant in this run. «passes» is what the commit claims of a
test; `.ci/run` compares it with what the tests have printed, and takes no commit of which one
fails or was not run. Each hazard, each reason that can be latched, each kind of fault of the
campaign and each safety function has a requirement, and each place in the code and each test that
is named exists; other tests in the same folder check that.
";

fn heading(page: &mut String, words: &str) {
    let _ = writeln!(page, "\n## {words}\n");
}

fn table(page: &mut String, columns: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
    let _ = writeln!(page, "| {} |", columns.join(" | "));
    let _ = writeln!(page, "|{}", "---|".repeat(columns.len()));
    for row in rows {
        assert_eq!(row.len(), columns.len());
        let _ = writeln!(page, "| {} |", row.join(" | "));
    }
}

/// A link to `path#item`, seen from the page.
fn linked(place: &str) -> String {
    let (path, item) = place.split_once('#').unwrap_or((place, ""));
    let name = if item.is_empty() {
        path.rsplit('/').next().unwrap_or(path)
    } else {
        item
    };
    format!("[`{name}`](../../{path})")
}

fn requirements(page: &mut String, source: &Source, results: &Results) {
    heading(page, "Requirements");
    let row = |requirement: &Requirement| {
        let code: Vec<_> = requirement.code.iter().map(|place| linked(place)).collect();
        let tests = requirement.tests.iter();
        let tests: Vec<_> = tests
            .map(|test| format!("{}: {}", linked(test), results.of(test)))
            .collect();
        let gap = requirement.gap.iter().map(|gap| format!(" **{gap}**"));
        vec![
            requirement.id.clone(),
            format!("{}{}", requirement.text, gap.collect::<String>()),
            requirement.hazards.join(", "),
            code.join(", "),
            tests.join("; "),
        ]
    };
    let columns = [
        "",
        "requirement",
        "against",
        "in the code",
        "shown by: result",
    ];
    table(page, &columns, source.requirement.iter().map(row));
}

fn speeds(up_m_per_s: f64, down_m_per_s: f64) -> String {
    if up_m_per_s.is_finite() {
        format!("{up_m_per_s:.2} / {down_m_per_s:.2}")
    } else {
        format!("beyond the plant's model / {down_m_per_s:.2}")
    }
}

fn campaign(page: &mut String, source: &Source, figures: &Figures) {
    heading(page, "One fault at a time");
    let all = figures.campaign.len();
    let violating = figures
        .campaign
        .iter()
        .filter(|one| !one.violations.is_empty());
    let _ = writeln!(
        page,
        "`hil-sim faults`, the first {CASES_PER_KIND} cases of each kind of fault with seed \
         {SEED}: {} of {all} cases violate a bound. \
         [safety.md](../safety.md#what-the-campaign-finds) has the violations without each \
         function.\n",
        violating.count(),
    );
    let row = |requirement: &Requirement| {
        let of_kinds: Vec<_> = figures
            .campaign
            .iter()
            .filter(|one| {
                let kind = KINDS[(one.case % KINDS.len() as u64) as usize].name;
                requirement.kinds.iter().any(|named| named == kind)
            })
            .collect();
        let most = |value: fn(&hil_sim::faults::outcome::Outcome) -> f64| {
            of_kinds.iter().map(|one| value(one)).fold(0.0, f64::max)
        };
        let fastest = speeds(
            most(|one| one.speed_up_m_per_s_max),
            most(|one| one.speed_down_m_per_s_max),
        );
        let violating = of_kinds.iter().filter(|one| !one.violations.is_empty());
        let latched = of_kinds.iter().filter(|one| one.reason.is_some());
        let is_shown = !of_kinds.is_empty();
        let shown = |text: String| if is_shown { text } else { "–".into() };
        vec![
            requirement.id.clone(),
            shown(requirement.kinds.join(", ")),
            shown(format!("{} of {}", violating.count(), of_kinds.len())),
            shown(fastest),
            shown(latched.count().to_string()),
            match &requirement.switch {
                Some(switch) => format!("`{switch}`"),
                None => "–".into(),
            },
        ]
    };
    let has_figures = |one: &&Requirement| !one.kinds.is_empty() || one.switch.is_some();
    let columns = [
        "",
        "kinds of fault",
        "violations",
        "fastest up / down \\[m/s\\]",
        "reason latched",
        "safety function",
    ];
    table(
        page,
        &columns,
        source.requirement.iter().filter(has_figures).map(row),
    );
}

/// Bounds that are violated, with the number of cases.
fn violated(outcomes: &[Ran]) -> String {
    let counts = tally(outcomes);
    let words = counts
        .iter()
        .map(|(bound, cases)| format!("{bound} {cases}"));
    let words: Vec<_> = words.collect();
    if words.is_empty() {
        "none".into()
    } else {
        words.join(", ")
    }
}

fn sequences(page: &mut String, figures: &Figures) {
    heading(page, "Sequences of faults and of what persons do");
    let _ = writeln!(
        page,
        "The first {SEQUENCES} of the 40 000 on the reference rig, and of the 40 000 on other \
         rigs, of [safety.md](../safety.md#sequences-and-the-bounds-of-the-body), against bounds \
         of the body.\n"
    );
    let classes = [(false, true), (false, false), (true, true), (true, false)];
    let rigs = [
        ("the reference", &figures.sequences),
        ("others", &figures.on_other_rigs),
    ];
    let classes = rigs
        .iter()
        .flat_map(|(rig, ran)| classes.map(|class| (*rig, *ran, class)));
    let rows = classes.map(|(rig, ran, (needs_hardware, enabling))| {
        let is_of = |(case, outcome): &&Ran| {
            outcome.needs_hardware == needs_hardware && case.enabling == enabling
        };
        let of: Vec<_> = ran.iter().filter(is_of).cloned().collect();
        vec![
            rig.into(),
            if needs_hardware {
                "hardware only"
            } else {
                "the controller"
            }
            .into(),
            if enabling { "yes" } else { "no" }.into(),
            of.len().to_string(),
            speeds(
                most(&of, |one| one.up_m_per_s),
                most(&of, |one| one.down_m_per_s),
            ),
            format!("{:.0}", most(&of, |one| 1e3 * one.unasked_m)),
            violated(&of),
        ]
    });
    let columns = [
        "rig",
        "limited by",
        "enabling device",
        "cases",
        "fastest up / down \\[m/s\\]",
        "not asked for \\[mm\\]",
        "violations",
    ];
    table(page, &columns, rows);
}

fn scenarios(page: &mut String, figures: &Figures) {
    heading(page, "Scenarios of an audit");
    let _ = writeln!(
        page,
        "An audit found the first campaign too narrow. «Before» is what it measured, against \
         0.67 m/s and 99 mm; a ripple is now averaged over the period, as the board does. The \
         worst of 16 rigs each, without and with an enabling device; one figure if both are \
         equal.\n"
    );
    let both = |outcomes: &[Vec<Ran>; 2], words: &dyn Fn(&[Ran]) -> String| {
        let [without, with] = [&outcomes[0], &outcomes[1]].map(|one| words(one));
        if without == with {
            without
        } else {
            format!("{without}; {with}")
        }
    };
    let rows = figures.scenarios.iter().map(|(scenario, outcomes)| {
        let has_limb = scenario.hand_m.or(scenario.foot_m).is_some();
        let fastest = |of: &[Ran]| {
            speeds(
                most(of, |one| one.up_m_per_s),
                most(of, |one| one.down_m_per_s),
            )
        };
        let unasked = |of: &[Ran]| format!("{:.0}", most(of, |one| 1e3 * one.unasked_m));
        let limb = |of: &[Ran]| {
            let (force_n, contact_s) = (most(of, |one| one.limb_n), most(of, |one| one.contact_s));
            format!("{force_n:.0} N, {contact_s:.1} s")
        };
        let reasons = |of: &[Ran]| {
            of.iter()
                .filter(|(_, one)| one.fault.is_some())
                .count()
                .to_string()
        };
        vec![
            scenario.name.into(),
            scenario.before.into(),
            both(outcomes, &fastest),
            both(outcomes, &unasked),
            if has_limb {
                both(outcomes, &limb)
            } else {
                String::new()
            },
            both(outcomes, &reasons),
            both(outcomes, &violated),
        ]
    });
    let columns = [
        "scenario",
        "before",
        "fastest up / down \\[m/s\\]",
        "not asked for \\[mm\\]",
        "force on the limb, contact",
        "with a reason, of 16",
        "bounds of the body violated",
    ];
    table(page, &columns, rows);
}

fn needed(page: &mut String, figures: &Figures) {
    heading(page, "What each safety function keeps");
    page.push_str(
        "A scenario for each function, of 16 rigs within their tolerances: how many violate the \
         bound of the body, and the worst values, with the function and without it.\n\n",
    );
    let rows = figures.needed.iter().map(|(needed, outcomes)| {
        let scenario = &needed.scenario;
        let violating = |of: &[Ran]| {
            tally(of)
                .get(needed.bound)
                .copied()
                .unwrap_or(0)
                .to_string()
        };
        let worst = |of: &[Ran]| match needed.bound {
            "speed up" => format!("{:.2} m/s", most(of, |one| one.up_m_per_s)),
            "height not asked for" => format!("{:.0} mm", most(of, |one| 1e3 * one.unasked_m)),
            "transient force" => format!("{:.0} N", most(of, |one| one.limb_n)),
            "lasting force" => format!("{:.1} s", most(of, |one| one.pressed_s)),
            _ => format!("{:.1} s", most(of, |one| one.contact_s)),
        };
        let [with, without] = outcomes;
        let shown = |of: &[Ran]| format!("{}: {}", violating(of), worst(of));
        vec![
            format!("`{}`", needed.function.name()),
            scenario.name.into(),
            if needed.enabling { "yes" } else { "no" }.into(),
            needed.bound.into(),
            shown(with),
            shown(without),
        ]
    });
    let columns = [
        "function",
        "scenario",
        "enabling device",
        "bound of the body",
        "with it",
        "without it",
    ];
    table(page, &columns, rows);
}

fn components(page: &mut String, source: &Source) {
    heading(page, "Performance level");
    page.push_str(
        "What each architecture could reach by the simplified procedure of ISO 13849-1:2015 \
         (4.5.4, table 7), if the failure rates below hold. They are assumptions, so the last \
         column has the level with each part lasting half and twice as long. Mean times are of \
         dangerous failures; more than 100 years of a channel do not count.\n\n",
    );
    let components = &source.component;
    let rows = components.iter().map(|component| {
        let rate = match (component.fit, component.b10d, component.operations_per_year) {
            (Some(fit), ..) => format!("{fit} FIT"),
            (_, Some(b10d), Some(operations)) => format!("B10d {b10d:e}, {operations} a year"),
            _ => String::new(),
        };
        vec![
            component.id.clone(),
            rate,
            format!("{:.0}", years(component)),
            component.source.clone(),
        ]
    });
    table(
        page,
        &["part", "assumed", "MTTFd \\[years\\]", "source"],
        rows,
    );
}

fn levels(page: &mut String, source: &Source) {
    components(page, source);
    let components = &source.component;
    page.push('\n');
    let shown = |level: Option<&str>| level.unwrap_or("none").to_string();
    let rows = source.architecture.iter().map(|one| {
        let function = source
            .function
            .iter()
            .find(|function| function.id == one.function);
        let required = &function.expect("a function").required;
        let mean_years = symmetric_years(one, components, 1.0);
        let halved = level(one, components, 0.5);
        let doubled = level(one, components, 2.0);
        vec![
            one.name.clone(),
            one.function.clone(),
            one.category.clone(),
            if one.channels.is_empty() {
                "–".into()
            } else {
                format!("{mean_years:.0}")
            },
            format!("{:.0} %", 100.0 * one.coverage),
            one.ccf.to_string(),
            format!("{} of {required}", shown(level(one, components, 1.0))),
            format!("{}, {}", shown(halved), shown(doubled)),
            one.why.clone(),
        ]
    });
    let columns = [
        "architecture",
        "function",
        "category",
        "MTTFd of a channel \\[years\\]",
        "DC",
        "CCF points",
        "level, of the required",
        "at half, at twice the times",
        "because",
    ];
    table(page, &columns, rows);
    page.push('\n');
    for function in &source.function {
        let (id, text, why) = (&function.id, &function.text, &function.why);
        let _ = writeln!(
            page,
            "- **{id}** {text}. Required: {}: {why}.",
            function.required
        );
    }
}

fn lists(page: &mut String, source: &Source) {
    for checklist in &source.checklist {
        heading(page, &format!("Checklist: {}", checklist.standard));
        let rows = checklist.items.iter().map(|item| {
            let is = match item.is.as_str() {
                "met" => "met",
                "part" => "in part",
                "rig" => "to be met by the rig",
                "no" => "**no**",
                other => panic!("{}: `{other}`", item.topic),
            };
            vec![item.topic.clone(), is.into(), item.how.clone()]
        });
        table(page, &["topic", "", "how"], rows);
    }
    heading(page, "What is not covered");
    for item in &source.uncovered.items {
        let _ = writeln!(page, "- {item}");
    }
    let gaps = source.requirement.iter().filter(|one| one.gap.is_some());
    let gaps: Vec<_> = gaps.map(|one| one.id.as_str()).collect();
    if !gaps.is_empty() {
        let _ = writeln!(
            page,
            "- Requirements that are not wholly kept: {}.",
            gaps.join(", ")
        );
    }
}

pub fn page(source: &Source, results: &Results, figures: &Figures) -> String {
    let mut page = INTRODUCTION.to_string();
    heading(&mut page, "Hazards");
    let hazards = source.hazard.iter().map(|hazard| {
        let of = source
            .requirement
            .iter()
            .filter(|one| one.hazards.contains(&hazard.id));
        let ids: Vec<_> = of.map(|one| one.id.as_str()).collect();
        vec![hazard.id.clone(), hazard.text.clone(), ids.join(", ")]
    });
    table(&mut page, &["", "hazard", "kept away by"], hazards);
    requirements(&mut page, source, results);
    campaign(&mut page, source, figures);
    sequences(&mut page, figures);
    scenarios(&mut page, figures);
    needed(&mut page, figures);
    heading(&mut page, "What only hardware can do");
    let rows = source
        .hardware
        .iter()
        .map(|one| vec![one.case.clone(), one.part.clone(), one.reaches.clone()]);
    table(
        &mut page,
        &["if", "part", "what it reaches in the campaign"],
        rows,
    );
    levels(&mut page, source);
    lists(&mut page, source);
    page
}
