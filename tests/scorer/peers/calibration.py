#!/usr/bin/env python3
"""Calibration alone, as a method that `score` measures: the prediction-error method (Ljung 1999).

It takes the structure of the rig for right and fits its nominal values, with their tolerances as priors, to
free runs of the records. It names nothing. A method of your own replaces `calibrated` and says more in
`diagnosis.json`; it needs nothing but this command line:

    calibration.py diagnose --rig RIG --fit REC [--fit REC ...] --validate REC [...] --out DIR

Needs numpy, scipy, pandas and the package hil_sim (`pip install ./python`), whose simulator it uses.
"""

import argparse
import json
import re
import tomllib
from pathlib import Path

import hil_sim
import numpy as np
import pandas as pd
from scipy.optimize import least_squares

SIGNALS = ["pressure_pa", "contraction", "force_n"]
# Free runs are compared ten times a second: what is left is not white, and says no more in between.
STEP_S = 0.1
# A gap of less than this many times the noise is one that the calibrated rig explains.
EXPLAINED = 1.1


def with_values(text, values):
    """The rig file with other values, by section and key."""
    for (section, key), value in values.items():
        in_section = rf"(?ms)(^\[{section}\]$.*?^{key}\s*=\s*)[-+0-9.eE_]+"
        text, count = re.subn(in_section, lambda found: f"{found[1]}{value:.9e}", text, count=1)
        assert count == 1, f"{section}.{key}"
    return text


def misses(rig, records):
    """Simulated less measured of each signal of each record."""
    for record in records:
        simulated = hil_sim.simulate(rig, record).record
        yield {
            name: (simulated[name] - record[name]).to_numpy()
            for name in SIGNALS
            if name in record and name in simulated
        }


def calibrated(text, records, noise):
    """The rig file with its values calibrated."""
    rig = tomllib.loads(text)
    keys = [(section, key) for section, own in rig.get("tolerance", {}).items() for key in own]
    nominal = np.array([rig[section][key] for section, key in keys])
    sigma = np.array([rig["tolerance"][section][key] for section, key in keys])
    steps = [max(1, round(STEP_S / np.median(np.diff(record["time_s"])))) for record in records]

    def rows(deviations):
        moved = with_values(text, dict(zip(keys, nominal * (1 + sigma * deviations))))
        try:
            missed = list(misses(hil_sim.Rig(moved), records))
        except hil_sim.BadInputError:
            # No rig has such values.
            return np.full(size, 1e3)
        parts = [own[name][::step] / noise[name] for own, step in zip(missed, steps) for name in own]
        return np.nan_to_num(np.concatenate([*parts, deviations]))

    size = len(keys) + sum(
        len(record[name][::step]) for record, step in zip(records, steps) for name in SIGNALS if name in record
    )
    found = least_squares(rows, np.zeros(len(keys)), loss="soft_l1", diff_step=1e-3, max_nfev=12)
    return with_values(text, dict(zip(keys, nominal * (1 + sigma * found.x))))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=["diagnose"])
    parser.add_argument("--rig", required=True, type=Path)
    parser.add_argument("--fit", required=True, action="append")
    parser.add_argument("--validate", required=True, action="append")
    parser.add_argument("--out", required=True, type=Path)
    given = parser.parse_args()
    text = given.rig.read_text()
    fit, validate = ([pd.read_csv(path) for path in paths] for paths in (given.fit, given.validate))
    checked = [hil_sim.check(record).signals.set_index("name")["noise"] for record in fit + validate]
    noise = {name: min(own[name] for own in checked) for name in SIGNALS if name in checked[0]}
    fitted = calibrated(text, fit, noise)

    def gap(rig_text):
        missed = list(misses(hil_sim.Rig(rig_text), validate))
        return {name: float(np.sqrt(np.nanmean(np.concatenate([own[name] for own in missed]) ** 2))) for name in noise}

    before, after = gap(text), gap(fitted)
    left = [name for name in noise if after[name] > EXPLAINED * noise[name]]
    diagnosis = {
        # Without probabilities.
        "schema": 1,
        "verdict": "unexplained" if left else "consistent",
        "effects": [],
        "gap": {name: {"before": before[name], "after": after[name], "noise": noise[name]} for name in noise},
        "remaining": {"where": left, "when": ""},
        "next_experiment": "",
        "warnings": [f"{name} is predicted worse" for name in noise if after[name] > before[name]],
    }
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "rig.fitted.toml").write_text(fitted)
    (given.out / "diagnosis.json").write_text(json.dumps(diagnosis, indent=2) + "\n")


if __name__ == "__main__":
    main()
