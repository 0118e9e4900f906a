//! Ablation with an effect removed from the tool's catalogue: its cases must not be explained by
//! another effect.

use crate::answer::Kind;
use crate::outcome::Outcome;
use crate::run::{self, Error, Selection, Tool};
use crate::scored::Scored;
use crate::statistics::Rate;
use hil_sim::report::{Report, Section, Table};
use serde::Serialize;
use std::path::Path;
use truth::Family;

/// Outcomes of one effect's cases with a tool that does not know the effect.
#[derive(Clone, Debug, Serialize)]
pub struct Without {
    /// The effect.
    pub name: String,
    /// `unexplained` without a named effect.
    pub abstained: Rate,
    /// `consistent`.
    pub missed: Rate,
    /// No diagnosis.
    pub no_answer: Rate,
    /// An effect is named.
    pub misnamed: Rate,
    /// The same, and according to the diagnosis no signal has a gap above the noise left.
    pub to_the_noise: Rate,
    /// The results by case.
    pub said: Vec<(String, String)>,
}

impl Without {
    /// In the order of the table.
    fn rates(&self) -> [Rate; 5] {
        [
            self.abstained,
            self.missed,
            self.misnamed,
            self.to_the_noise,
            self.no_answer,
        ]
    }
}

/// Names that can be taken out.
pub fn listed(family: Family) -> Vec<&'static str> {
    family.listed()
}

/// Share of what is above the noise with which nothing is left of it, to rounding.
const ALL: f64 = 0.99;

/// Scores the visible cases of an effect that were run without it.
pub fn judge(name: &str, cases: &[Scored]) -> Without {
    let visible = || cases.iter().filter(|case| case.visible);
    let with = |outcome| {
        let unnamed = |case: &&Scored| case.outcome == outcome && case.named.is_empty();
        Rate::among(visible(), unnamed)
    };
    let said = |case: &Scored| (case.answer.id.clone(), case.said());
    Without {
        name: name.into(),
        abstained: with(Outcome::Abstained),
        missed: with(Outcome::Missed),
        no_answer: with(Outcome::NoAnswer),
        misnamed: Rate::among(visible(), |case| !case.named.is_empty()),
        to_the_noise: Rate::among(visible(), |case| {
            !case.named.is_empty() && case.share_explained.is_some_and(|share| share >= ALL)
        }),
        said: visible().map(said).collect(),
    }
}

/// Runs the tool without effect `name` on `count` cases of that effect alone.
///
/// # Errors
/// As [`run::run`].
pub fn without(
    out: &Path,
    name: &str,
    family: Family,
    [seed, first]: [u64; 2],
    count: usize,
    tool: &Tool,
) -> Result<Without, Error> {
    let mut tool = tool.clone();
    tool.arguments
        .extend(["--without".to_owned(), name.to_owned()]);
    let selection = Selection {
        family,
        seed,
        first,
        count,
        kinds: vec![Kind::Single],
        effects: vec![name.into()],
        max_rows: None,
    };
    let collected = run::run(&out.join(name), &selection, &tool)?;
    let cases: Vec<Scored> = collected.iter().map(Scored::new).collect();
    Ok(judge(name, &cases))
}

/// All effects together.
pub fn total(parts: &[Without]) -> [Rate; 5] {
    std::array::from_fn(|place| {
        let rates = parts.iter().map(|part| part.rates()[place]);
        let (hits, of) = rates.fold((0, 0), |(hits, of), r| (hits + r.hits, of + r.of));
        Rate::new(hits, of)
    })
}

/// The report.
pub fn report(parts: &[Without], command: &str) -> Report {
    let shown = |rate: Rate| match rate.of {
        0 => String::new(),
        of => format!("{}/{of}", rate.hits),
    };
    let row = |name: &str, rates: [Rate; 5], said: String| {
        let mut cells = vec![name.to_owned()];
        cells.extend(rates.map(shown));
        cells.push(said);
        cells
    };
    let mut rows: Vec<Vec<String>> = parts
        .iter()
        .map(|part| {
            let said = part.said.iter().filter(|(_, said)| said != "unexplained");
            let said: Vec<String> = said.map(|(id, said)| format!("{id}: {said}")).collect();
            row(&part.name, part.rates(), said.join("; "))
        })
        .collect();
    let total = total(parts);
    rows.push(row("all", total, String::new()));
    let columns = [
        "taken out",
        "unexplained",
        "consistent",
        "misnamed",
        "nothing left to tell",
        "no answer",
        "what else was said",
    ];
    let share = |rate: Rate| rate.value.map_or(0.0, |value| 100.0 * value);
    Report {
        title: "Ablation: each effect taken out of the catalogue".into(),
        verdict: vec![format!(
            "On their own cases {:.0} % are left unexplained and {:.0} % get a wrong name; in \
             {:.0} % that leaves nothing above the noise to tell it by.",
            share(total[0]),
            share(total[2]),
            share(total[3])
        )],
        sections: vec![Section {
            heading: "Without".into(),
            tables: vec![Table {
                caption: "Single effects that show, diagnosed without knowing them".into(),
                columns: columns.map(String::from).into(),
                rows,
            }],
            ..Section::default()
        }],
        repeat: vec![command.into()],
    }
}
