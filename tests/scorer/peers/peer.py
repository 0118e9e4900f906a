"""What the peers of this folder share: the command line, calibration, the gap and the answer's files.

Needs numpy, scipy, pandas and the package hil_sim (`pip install ./python`), whose simulator it uses.
"""

import argparse
import json
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import hil_sim
import numpy as np
import pandas as pd

SIGNALS = ["pressure_pa", "contraction", "force_n"]
# Simulations are compared ten times a second: the misfit is not white, and says no more in between.
STEP_S = 0.1
# Records are calibrated with at most about this many rows per second. On records of 353 rows per second that changed
# six of seven values by less than 0.05 of their tolerance and the viscous damping by 0.15 (case d101-00002).
ROWS_PER_S = 50
# A gap of less than this many times the noise is one that the rig explains.
EXPLAINED = 1.1


@dataclass
class Case:
    """What a method is given: the rig's text, the records, and each signal's noise."""

    text: str
    fit: list[pd.DataFrame]
    validate: list[pd.DataFrame]
    out: Path
    noise: dict[str, float]

    @staticmethod
    def read(given):
        """The case of a command line."""
        fit, validate = ([pd.read_csv(path) for path in paths] for paths in (given.fit, given.validate))
        checked = [hil_sim.check(record).signals.set_index("name")["noise"] for record in fit + validate]
        noise = {name: min(own[name] for own in checked) for name in SIGNALS if name in checked[0]}
        given.out.mkdir(parents=True, exist_ok=True)
        return Case(given.rig.read_text(), fit, validate, given.out, noise)


@dataclass
class Effect:
    """An effect of the catalogue with its parameters, each with the range that it may have."""

    name: str
    where: str
    form: str | None
    values: dict[str, float]
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)

    def lines(self):
        """The effect's section of a rig file."""
        form = [f'form = "{self.form}"'] if self.form else []
        values = [f"{key} = {value:.9e}" for key, value in self.values.items()]
        return "\n".join(["", "[[effect]]", f'name = "{self.name}"', *form, *values, ""])


def arguments(doc, commands=("diagnose",)):
    """The command line that `score` calls: `diagnose`, and `simulate` of a method that predicts by itself."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    subparsers = parser.add_subparsers(dest="command", required=True)
    diagnose = subparsers.add_parser("diagnose")
    diagnose.add_argument("--rig", required=True, type=Path)
    diagnose.add_argument("--fit", required=True, action="append")
    diagnose.add_argument("--validate", required=True, action="append")
    diagnose.add_argument("--out", required=True, type=Path)
    if "simulate" in commands:
        simulate = subparsers.add_parser("simulate")
        for name in ("--rig", "--drive", "--out"):
            simulate.add_argument(name, required=True, type=Path)
    return parser.parse_args()


def with_values(text, values):
    """The rig file with other values, by section and key."""
    for (section, key), value in values.items():
        in_section = rf"(?ms)(^\[{section}\]$.*?^{key}\s*=\s*)[-+0-9.eE_]+"
        text, count = re.subn(in_section, lambda found: f"{found[1]}{value:.9e}", text, count=1)
        assert count == 1, f"{section}.{key}"
    return text


def misfits(text, records):
    """Simulated less measured of each signal of each record."""
    for record in records:
        simulated = hil_sim.simulate(hil_sim.Rig(text), record).record
        yield {
            name: (simulated[name] - record[name]).to_numpy()
            for name in SIGNALS
            if name in record and name in simulated
        }


def gap(text, case, records):
    """Root mean square of simulated less measured of each signal over the records."""
    missed = list(misfits(text, records))
    return {name: float(np.sqrt(np.nanmean(np.concatenate([own[name] for own in missed]) ** 2))) for name in case.noise}


def thinned(record):
    """The record with fewer rows; the reference of each is the mean until the next."""
    step = int(1 / (ROWS_PER_S * np.median(np.diff(record["time_s"])))) or 1
    few = record.iloc[::step].reset_index(drop=True)
    reference = record["pressure_ref_pa"].to_numpy()
    begins = np.arange(0, len(reference), step)
    few["pressure_ref_pa"] = np.add.reduceat(reference, begins) / np.diff(np.append(begins, len(reference)))
    return few


class Unknowns:
    """The rig's values that have a tolerance, and parameters of effects, as deviations of order 1."""

    def __init__(self, text, effects=()):
        self.text, self.effects = text, effects
        rig = tomllib.loads(text)
        self.keys = [(section, key) for section, own in rig.get("tolerance", {}).items() for key in own]
        self.nominal = np.array([rig[section][key] for section, key in self.keys])
        self.sigma = np.array([rig["tolerance"][section][key] for section, key in self.keys])
        # A parameter's deviation is that of its logarithm, or of its value in halves of its start.
        self.free = [(effect, key) for effect in effects for key in effect.values if effect.values[key] != 0]

    def __len__(self):
        return len(self.keys) + len(self.free)

    def moved(self, deviations):
        """The effects with other values."""
        own = [Effect(e.name, e.where, e.form, dict(e.values), e.ranges) for e in self.effects]
        for (effect, key), deviation in zip(self.free, deviations[len(self.keys) :]):
            value = effect.values[key] * np.exp(np.clip(deviation, -4, 4))
            low, high = effect.ranges.get(key, (-np.inf, np.inf))
            own[self.effects.index(effect)].values[key] = float(np.clip(value, low, high))
        return own

    def rig(self, deviations):
        """The rig file with other values."""
        values = self.nominal * (1 + self.sigma * deviations[: len(self.keys)])
        text = with_values(self.text, dict(zip(self.keys, values)))
        return text + "".join(effect.lines() for effect in self.moved(deviations))


def calibrated(case, effects=(), evaluations=12):
    """The rig file with its values, and the parameters of effects, fitted to free runs of the records.

    The prediction-error method (Ljung 1999) with the tolerances as priors. Returns the text, the effects and
    the deviations of the rig's values in units of their tolerance.
    """
    # Here, because a method's `simulate` does without it.
    from scipy.optimize import least_squares

    unknowns = Unknowns(case.text, effects)
    records = [thinned(record) for record in case.fit]
    steps = [max(1, round(STEP_S / np.median(np.diff(record["time_s"])))) for record in records]
    size = sum(len(record[name][::step]) for record, step in zip(records, steps) for name in SIGNALS if name in record)

    def rows(deviations):
        try:
            missed = list(misfits(unknowns.rig(deviations), records))
        except hil_sim.BadInputError:
            # No rig has such values.
            return np.full(size + len(deviations), 1e3)
        parts = [own[name][::step] / case.noise[name] for own, step in zip(missed, steps) for name in own]
        return np.nan_to_num(np.concatenate([*parts, deviations]))

    start = np.zeros(len(unknowns))
    found = least_squares(rows, start, loss="soft_l1", diff_step=1e-3, max_nfev=evaluations)
    return unknowns.rig(found.x), unknowns.moved(found.x), found.x[: len(unknowns.keys)]


def unexplained(case, after):
    """Signals whose gap is above the noise."""
    return [name for name in case.noise if after[name] > EXPLAINED * case.noise[name]]


def answer(case, fitted, verdict, named=(), after=None, hypotheses=None):
    """Writes the fitted rig and the diagnosis; `named` are the entries of `effects`."""
    before = gap(case.text, case, case.validate)
    after = after or gap(fitted, case, case.validate)
    diagnosis = {
        # Schema 1 is that without probabilities.
        "schema": 1 if hypotheses is None else 2,
        "verdict": verdict,
        "effects": list(named),
        "gap": {
            name: {"before": before[name], "after": after[name], "noise": noise} for name, noise in case.noise.items()
        },
        "remaining": {"where": unexplained(case, after), "when": ""},
        "next_experiment": "",
        "hypotheses": hypotheses or [],
        "warnings": [f"{name} is predicted worse" for name in case.noise if after[name] > before[name]],
    }
    (case.out / "rig.fitted.toml").write_text(fitted)
    (case.out / "diagnosis.json").write_text(json.dumps(diagnosis, indent=2) + "\n")
