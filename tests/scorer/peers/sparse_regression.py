#!/usr/bin/env python3
"""Sparse regression of the residual, as a method that `score` measures: SINDy (Brunton et al. 2016).

If calibration leaves a gap, it regresses the residuals of the balances of gas, force and load, in weak form
(`balances.py`), on a library of terms, each of which stands for an effect of the catalogue (`terms.py`):
the rig's values are regressors with priors; for each effect one point of its grid is taken by orthogonal
least squares, and sequentially thresholded least squares (PySINDy's STLSQ) drops the terms that explain too
little. Probabilities are inclusion frequencies among bootstraps of blocks of time (ensemble SINDy, Fasel et
al. 2022). The named effects are refined, with the rig's values, by free runs.

    sparse_regression.py diagnose --rig RIG --fit REC [--fit REC ...] --validate REC [...] --out DIR

Needs what calibration.py needs, and pysindy.
"""

import tomllib
import warnings
from collections import Counter
from dataclasses import dataclass

import balances
import hil_sim
import numpy as np
import peer
import pysindy
import terms

# The first term must explain this share of the residual's squares, each further one this share of what is left.
SHARE = 0.4
LATER = 0.5
# Effects that are looked for at most.
SEVERAL = 4
# Sum of squares by which a term must be better than none, beside its share: overlapping rows count twice.
LEAST = 100.0
BOOTSTRAPS = 40
BLOCK_S = 3.0
# Frequency among bootstraps from which a term is named.
INCLUDED = 0.5
# Share of the gap above the noise, on the validation records, that named effects must remove.
USEFUL = 0.4


@dataclass
class Regression:
    """Products of the columns: the rig's values, the library's and the residual, by block of time."""

    library: list[terms.Term]
    places: list[slice]
    values: int
    products: np.ndarray
    prior: np.ndarray

    @staticmethod
    def of(case):
        """Of the fit records and the given rig, about which its values are linear."""
        text = case.text
        records, weights, blocks = [], [], []
        for number, record in enumerate(case.fit):
            own = balances.Balances(balances.Signals.of(record), text, case.noise)
            simulated = hil_sim.simulate(hil_sim.Rig(text), record).record
            simulated = record.assign(**{name: simulated[name] for name in case.noise})
            # What the grid and the bumps leave of a record without noise and without effects.
            exact = balances.Balances(balances.Signals.of(simulated), text, case.noise)
            weights.append(1 / np.sqrt(1 + exact.rows() ** 2))
            records.append(own)
            blocks.append(1000 * number + own.names()[1] // BLOCK_S)
        weight, block = np.concatenate(weights), np.concatenate(blocks)
        base = np.concatenate([own.rows() for own in records])
        library = terms.library(records)
        columns = [value_columns(text, records, base)]
        values = columns[0].shape[1]
        places, begin = [], 0
        for term in library:
            columns.append(term.columns(records, base))
            places.append(slice(begin, begin + columns[-1].shape[1]))
            begin = places[-1].stop
        matrix = weight[:, None] * np.column_stack([*columns, base])
        matrix = np.nan_to_num(matrix, posinf=0.0, neginf=0.0)
        products = np.array([matrix[block == b].T @ matrix[block == b] for b in np.unique(block)])
        # The rig's values are their nominal ones but for their tolerances.
        prior = np.zeros(products.shape[1:])
        own = np.arange(values)
        prior[own, own] = 1.0
        return Regression(library, places, values, products, prior)

    def projected(self, weights):
        """Products of the library and the residual, less what the rig's values explain."""
        gram = np.tensordot(weights, self.products, axes=1) + self.prior
        n = self.values
        inner = gram[:n, :n] + 1e-9 * np.eye(n)
        return gram[n:, n:] - gram[n:, :n] @ np.linalg.solve(inner, gram[:n, n:])

    def solved(self, gram, chosen):
        """Coefficients of the chosen terms within their bounds, and the sum of squares that is left."""
        index = np.concatenate([np.arange(len(gram) - 1)[self.places[term]] for term in chosen])
        bounds = np.array([bound for term in chosen for bound in self.library[term].bounds])
        inner = gram[np.ix_(index, index)]
        inner = inner + np.diag(1e-9 * np.diag(inner) + 1e-12)
        right = gram[index, -1]
        solution = np.linalg.solve(inner, right)
        outside = (solution < bounds[:, 0]) | (solution > bounds[:, 1])
        if outside.any():
            solution = np.clip(solution, bounds[:, 0], bounds[:, 1])
            free = ~outside
            if free.any():
                rest = right[free] - inner[np.ix_(free, outside)] @ solution[outside]
                solution[free] = np.linalg.solve(inner[np.ix_(free, free)], rest)
                solution = np.clip(solution, bounds[:, 0], bounds[:, 1])
        return solution, gram[-1, -1] - 2 * right @ solution + solution @ inner @ solution

    def selected(self, weights):
        """Indices of the terms that survive, and their coefficients."""
        gram = self.projected(weights)
        rows = weights.sum()
        chosen, left, least = [], gram[-1, -1], LEAST
        while len(chosen) < SEVERAL and rows:
            least = max(LEAST, (LATER if chosen else SHARE) * left)
            names = {self.library[term].name for term in chosen}
            others = [i for i, term in enumerate(self.library) if term.name not in names]
            tried = [(self.solved(gram, [*chosen, i])[1], i) for i in others]
            best, place = min(tried)
            if left - best < least:
                break
            chosen, left = self.refined(gram, [*chosen, place])
        return self.thresholded(gram, chosen, least)

    def refined(self, gram, chosen):
        """Each chosen effect at the point of its grid that is best with the others."""
        for place in range(len(chosen)):
            name = self.library[chosen[place]].name
            points = [i for i, term in enumerate(self.library) if term.name == name]
            tried = [(self.solved(gram, [*chosen[:place], i, *chosen[place + 1 :]])[1], i) for i in points]
            chosen[place] = min(tried)[1]
        return chosen, self.solved(gram, chosen)[1]

    def thresholded(self, gram, chosen, least):
        """Sequentially thresholded least squares over the chosen effects, a normalised column each."""
        if not chosen:
            return [], []
        solution, _ = self.solved(gram, chosen)
        parts = np.split(solution, np.cumsum([len(self.library[term].bounds) for term in chosen])[:-1])
        combined = np.zeros((len(gram), len(chosen) + 1))
        for column, (term, part) in enumerate(zip(chosen, parts)):
            combined[np.arange(len(gram) - 1)[self.places[term]], column] = part
        combined[-1, -1] = 1.0
        small = combined.T @ gram @ combined
        norms = np.sqrt(np.maximum(np.diag(small)[:-1], 1e-12))
        root = np.linalg.cholesky(small + 1e-9 * np.diag(np.diag(small) + 1e-9)).T
        optimizer = pysindy.STLSQ(threshold=np.sqrt(0.5 * least), alpha=1e-6)
        with warnings.catch_warnings():
            # That nothing survives is an answer.
            warnings.simplefilter("ignore", UserWarning)
            optimizer.fit(root[:, :-1] / norms, root[:, -1:])
        kept = np.abs(np.ravel(optimizer.coef_)) > 0
        survivors = [term for term, keep in zip(chosen, kept) if keep]
        if not survivors:
            return [], []
        solution, _ = self.solved(gram, survivors)
        return survivors, np.split(solution, np.cumsum([len(self.library[t].bounds) for t in survivors])[:-1])


def value_columns(text, records, base):
    """Changes of the rows by a tolerance of each of the rig's values."""
    columns = [np.zeros((len(base), 0))]
    for section, tolerances in tomllib.loads(text).get("tolerance", {}).items():
        for key, tolerance in tolerances.items():
            rig = tomllib.loads(text)
            rig[section][key] *= 1 + tolerance
            moved = np.concatenate([own.rows(balances.Change(rig=rig)) for own in records])
            columns.append((base - moved)[:, None])
    return np.hstack(columns)


def ensemble(regression):
    """Sets of names among bootstraps, with their frequencies."""
    generator = np.random.default_rng(1)
    count = len(regression.products)
    sets = Counter()
    for _ in range(BOOTSTRAPS):
        weights = np.bincount(generator.integers(count, size=count), minlength=count).astype(float)
        survivors, _ = regression.selected(weights)
        sets[frozenset(regression.library[term].name for term in survivors)] += 1
    return {names: number / BOOTSTRAPS for names, number in sets.items()}


def ranges():
    """The range of each parameter of the catalogue, and the subsystem of each effect."""
    kinds = hil_sim.effects()
    return {
        kind.name: (
            kind.subsystem,
            {form["name"]: {own["key"]: (own["min"], own["max"]) for own in form["keys"]} for form in kind.forms},
        )
        for kind in kinds
    }


def effects(regression, survivors, coefficients):
    """The effects of a rig file that the surviving terms stand for."""
    known, found = ranges(), []
    for term, own in zip(survivors, coefficients):
        term = regression.library[term]
        where, forms = known[term.name]
        limits = forms[term.form or next(iter(forms))]
        values = {key: float(np.clip(value, *limits[key])) for key, value in term.values(own).items()}
        found.append(peer.Effect(term.name, where, term.form, values, limits))
    return found


def named(found, frequencies):
    """The entries of `effects` in the diagnosis."""
    return [
        {
            "name": effect.name,
            "where": effect.where,
            "parameters": {},
            "alternatives": [],
            "probability": sum(share for names, share in frequencies.items() if effect.name in names),
        }
        for effect in found
    ]


def removed(case, before, after):
    """Share of the gap above the noise that is removed, over all signals."""
    gaps = [sum(gap[name] / noise for name, noise in case.noise.items()) for gap in (before, after)]
    return (gaps[0] - gaps[1]) / max(gaps[0] - len(case.noise), 1e-9)


def main():
    case = peer.Case.read(peer.arguments(__doc__))
    fitted, _, _ = peer.calibrated(case)
    after = peer.gap(fitted, case, case.validate)
    found, frequencies = [], {frozenset(): 1.0}
    if peer.unexplained(case, after):
        regression = Regression.of(case)
        frequencies = ensemble(regression)
        survivors, coefficients = regression.selected(np.ones(len(regression.products)))
        found = effects(regression, survivors, coefficients)
        often = {entry["name"] for entry in named(found, frequencies) if entry["probability"] >= INCLUDED}
        found = [effect for effect in found if effect.name in often]
    if found:
        refined, found, _ = peer.calibrated(case, found)
        refined_gap = peer.gap(refined, case, case.validate)
        if removed(case, after, refined_gap) >= USEFUL:
            fitted, after = refined, refined_gap
        else:
            found = []
    remains = peer.unexplained(case, after)
    verdict = ("partial" if remains else "explained") if found else ("unexplained" if remains else "consistent")
    hypotheses = [{"effects": sorted(names), "probability": share} for names, share in frequencies.items()]
    peer.answer(case, fitted, verdict, named(found, frequencies), after, hypotheses)


if __name__ == "__main__":
    main()
