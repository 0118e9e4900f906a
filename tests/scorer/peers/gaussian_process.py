#!/usr/bin/env python3
"""A Gaussian process for what the model lacks, as a method that `score` measures: Kennedy & O'Hagan 2001.

Measured = simulated with calibrated values + discrepancy + noise. The values are calibrated first, and the
discrepancy of each signal, a Gaussian process of the simulated run's states, rates and lagged values, is
conditioned on what is left (modular, as Liu, Bayarri & Berger 2009). It predicts, and names nothing: `simulate`
adds the process's mean, which `diagnose` keeps beside the fitted rig.

    gaussian_process.py diagnose --rig RIG --fit REC [--fit REC ...] --validate REC [...] --out DIR
    gaussian_process.py simulate --rig RIG --drive REC --out REC

Needs what calibration.py needs, and scikit-learn.
"""

import warnings
from dataclasses import dataclass
from itertools import accumulate

import hil_sim
import numpy as np
import pandas as pd
import peer

FILE = "discrepancy.npz"
# Points on which the kernel's length scales are found, and those on which the process is conditioned.
TUNING = 250
CONDITIONING = 1200
# Time constants of what the inputs remember [s], and the reference's lag.
MEMORY_S = (0.05, 0.3, 2.0, 15.0)
# Signals are smoothed over this time before their rate is taken.
RATE_S = 0.05


def smoothed(values, width):
    """Means over about `width` rows; the ends are held."""
    half = width // 2
    padded = np.pad(values, half, mode="edge")
    return np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")


def inputs(drive, simulated):
    """Inputs of the process at each row: states, rates and memories of the simulated run."""
    time = drive["time_s"].to_numpy()
    period = float(np.median(np.diff(time)))
    width = max(1, round(RATE_S / period))
    reference = drive["pressure_ref_pa"].to_numpy()
    pressure, contraction = (simulated[name].to_numpy() for name in ("pressure_pa", "contraction"))
    rates = [np.gradient(smoothed(own, width), time) for own in (pressure, contraction)]
    columns = [reference - pressure, pressure, contraction, *rates]
    for tau in MEMORY_S:
        share = -np.expm1(-period / tau)
        for own in (reference, contraction):
            memory = accumulate(own.tolist(), lambda before, now, share=share: before + share * (now - before))
            columns.append(own - np.fromiter(memory, float))
    return np.column_stack(columns)


@dataclass
class Discrepancy:
    """The mean of a Gaussian process with a squared exponential kernel, a length scale for each input."""

    centre: np.ndarray
    spread: np.ndarray
    points: np.ndarray
    weights: np.ndarray
    mean: float

    @staticmethod
    def conditioned(states, residual, generator):
        """Of the residual at the states."""
        # Here, because `simulate` does without it.
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

        centre, spread = states.mean(axis=0), states.std(axis=0) + 1e-12
        scaled = (states - centre) / spread
        mean, size = float(residual.mean()), float(residual.std()) + 1e-12
        target = (residual - mean) / size
        lengths = np.full(scaled.shape[1], 3.0)
        kernel = ConstantKernel(1.0, (1e-3, 1e3)) * RBF(lengths, (0.2, 100.0)) + WhiteKernel(0.3, (1e-5, 2.0))
        few = generator.choice(len(target), min(TUNING, len(target)), replace=False)
        with warnings.catch_warnings():
            # A length scale at its bound is one of an input that says nothing.
            warnings.simplefilter("ignore", ConvergenceWarning)
            tuned = GaussianProcessRegressor(kernel).fit(scaled[few], target[few]).kernel_
        more = generator.choice(len(target), min(CONDITIONING, len(target)), replace=False)
        process = GaussianProcessRegressor(tuned, optimizer=None).fit(scaled[more], target[more])
        lengths = tuned.k1.k2.length_scale
        weights = size * tuned.k1.k1.constant_value * process.alpha_
        return Discrepancy(centre, spread * lengths, (scaled[more] / lengths).T, weights, mean)

    def predicted(self, states):
        """The mean at other states."""
        scaled = (states - self.centre) / self.spread
        parts = np.array_split(scaled, len(scaled) // 2000 + 1)
        norms = (self.points**2).sum(axis=0)
        squares = [(own**2).sum(axis=1)[:, None] + norms - 2 * own @ self.points for own in parts]
        return self.mean + np.concatenate([np.exp(-0.5 * np.maximum(own, 0)) @ self.weights for own in squares])


def predicted(text, record, discrepancies):
    """The simulated record with the means of the processes."""
    simulated = hil_sim.simulate(hil_sim.Rig(text), record).record
    found = simulated.copy()
    if discrepancies:
        states = inputs(record, simulated)
        for name, own in discrepancies.items():
            found[name] = simulated[name] + own.predicted(states)
    return found


def discrepancies(text, case):
    """A process for each signal that it predicts better on the validation records."""
    generator = np.random.default_rng(1)
    simulated = [hil_sim.simulate(hil_sim.Rig(text), record).record for record in case.fit]
    states = np.concatenate([inputs(*pair) for pair in zip(case.fit, simulated)])
    found = {}
    for name in case.noise:
        residual = np.concatenate([(r[name] - s[name]).to_numpy() for r, s in zip(case.fit, simulated)])
        known = np.isfinite(residual) & np.isfinite(states).all(axis=1)
        found[name] = Discrepancy.conditioned(states[known], residual[known], generator)
    with_all, without = gap(text, case, found), gap(text, case, {})
    return {name: own for name, own in found.items() if with_all[name] < without[name]}


def gap(text, case, found):
    """Root mean square of predicted less measured of each signal over the validation records."""
    missed = [(predicted(text, record, found), record) for record in case.validate]
    return {
        name: float(np.sqrt(np.nanmean(np.concatenate([(p[name] - r[name]).to_numpy() for p, r in missed]) ** 2)))
        for name in case.noise
    }


def diagnose(given):
    case = peer.Case.read(given)
    fitted, _, _ = peer.calibrated(case)
    calibrated = peer.gap(fitted, case, case.validate)
    found = discrepancies(fitted, case)
    arrays = {f"{name} {key}": value for name, own in found.items() for key, value in vars(own).items()}
    np.savez(case.out / FILE, **arrays)
    # It is in the discrepancy that something is missing, whatever the process makes of it.
    verdict = "unexplained" if peer.unexplained(case, calibrated) else "consistent"
    peer.answer(case, fitted, verdict, after=gap(fitted, case, found))


def simulate(given):
    file = given.rig.with_name(FILE)
    found = {}
    if file.is_file() and given.rig.name == "rig.fitted.toml":
        with np.load(file) as arrays:
            for name in {key.split()[0] for key in arrays}:
                found[name] = Discrepancy(
                    **{key.split()[1]: arrays[key] for key in arrays if key.startswith(f"{name} ")}
                )
    predicted(given.rig.read_text(), pd.read_csv(given.drive), found).to_csv(given.out, index=False)


def main():
    given = peer.arguments(__doc__, ("diagnose", "simulate"))
    {"diagnose": diagnose, "simulate": simulate}[given.command](given)


if __name__ == "__main__":
    main()
