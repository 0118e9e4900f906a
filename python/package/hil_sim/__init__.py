"""Which effect is missing from your simulation of a pneumatic-muscle rig?

The commands of ``hil-sim`` from Python: the same results, as objects, with the same words for what is
wrong. Records are pandas DataFrames, dicts of numpy arrays, or the names of CSV files; their columns are in
SI units, which are part of their names (``time_s``, ``pressure_pa``; gauge pressures). Each result has the
command's JSON as text in ``json``.

    import hil_sim

    rig = hil_sim.Rig.read("rig.toml")
    found = hil_sim.diagnose(rig, fit=[lifts, steps], validate=[sines])
    print(found)
    found.plot()
"""

from __future__ import annotations

import json as _json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Union

import numpy as np
import pandas as pd

from . import _native
from ._native import BadInputError, __version__

__all__ = [
    "BadInputError",
    "Check",
    "Design",
    "Diagnosis",
    "Effect",
    "EffectKind",
    "Estimate",
    "Experiment",
    "Gap",
    "Hypothesis",
    "Rig",
    "Simulation",
    "check",
    "design",
    "diagnose",
    "effects",
    "experiment",
    "simulate",
]

Record = Union[pd.DataFrame, Mapping[str, Any], str, os.PathLike]
"""A record: a DataFrame, a mapping of columns, or the name of a CSV file."""

Progress = Callable[[str, int, list[str]], None]
"""Is told the stage, how many sets of effects it tries, and the effects of the set that is tried."""


@dataclass(frozen=True)
class Rig:
    """A rig: the text of a rig file (TOML), and the name of the file, for messages."""

    text: str
    name: str = "rig.toml"

    @staticmethod
    def read(path: str | os.PathLike) -> Rig:
        """The rig file at ``path``."""
        return Rig(Path(path).read_text(encoding="utf-8"), os.fspath(path))

    @staticmethod
    def template() -> Rig:
        """The paper's rig with comments, to be edited."""
        return Rig(_native.rig_template())

    def check(self, *, accept: bool = False) -> None:
        """Raises :class:`BadInputError` if a value is missing, wrong, or in another unit than its name says."""
        _native.check_rig(self, accept)

    def write(self, path: str | os.PathLike) -> None:
        """Writes the rig file."""
        Path(path).write_text(self.text, encoding="utf-8")


@dataclass(frozen=True)
class _Record:
    """What the native module reads: a file's name, or columns."""

    name: str
    columns: list[tuple[str, bytes]] | None


# The columns that are read (docs/records.md).
_NUMBERS = {
    "time_s",
    "pressure_ref_pa",
    "pressure_pa",
    "contraction",
    "force_n",
    "finger_m",
    "input_force_n",
    "supply_pa",
    "temperature_k",
    "valve_open",
}


def _record(record: Record, place: str) -> _Record:
    if isinstance(record, (str, os.PathLike)):
        return _Record(os.fspath(record), None)
    names = record.columns if isinstance(record, pd.DataFrame) else record.keys()
    columns = []
    for name in names:
        values = record[name]
        if not isinstance(name, str):
            raise TypeError(f"{place}: expected columns with names, found {name!r}")
        if name not in _NUMBERS:
            # Words, as a recorded mode: nothing reads them. What resembles a known name is told below.
            values = np.full(np.shape(values)[0], np.nan)
        else:
            try:
                values = values.to_numpy(np.float64, na_value=np.nan) if isinstance(values, pd.Series) else values
                values = np.asarray(values, dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise BadInputError(f"{place}: column `{name}`: expected numbers, {error}") from None
        if values.ndim != 1:
            raise BadInputError(f"{place}: column `{name}`: expected one dimension, found {values.ndim}")
        columns.append((name, values.tobytes()))
    return _Record(place, columns)


def _frame(columns: list[tuple[str, bytes]]) -> pd.DataFrame:
    return pd.DataFrame({name: np.frombuffer(values, dtype=np.float64) for name, values in columns})


def _rig(rig: Rig | str | os.PathLike) -> Rig:
    return rig if isinstance(rig, Rig) else Rig.read(rig)


@dataclass(frozen=True)
class Gap:
    """Root mean square of simulated less measured of a signal over the validation records.

    In the column's unit; ``removed`` is the share of the gap above the noise that the fitted rig removes,
    None where there was none.
    """

    before: float
    after: float
    noise: float
    removed: float | None


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval."""

    value: float
    ci95: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class Effect:
    """A named effect: how probable it is, and its parameters."""

    name: str
    form: str
    where: str
    probability: float
    alternatives: tuple[str, ...]
    parameters: dict[str, Estimate]
    shape: dict[str, Any] | None
    evidence: dict[str, Any]


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects, the subsystems in which something is unknown beside it, and its probability."""

    effects: tuple[str, ...]
    unknown: tuple[str, ...]
    probability: float


def _effect(found: dict[str, Any]) -> Effect:
    parameters = {
        key: Estimate(own["value"], tuple(own["ci95"]), own["unit"])
        for key, own in found["parameters"].items()
    }
    return Effect(
        name=found["name"],
        form=found["form"],
        where=found["where"],
        probability=found["probability"],
        alternatives=tuple(found["alternatives"]),
        parameters=parameters,
        shape=found["shape"],
        evidence=found["evidence"],
    )


@dataclass(frozen=True)
class Diagnosis:
    """What is missing from the rig: the command's ``diagnosis.json``."""

    verdict: str
    effects: tuple[Effect, ...]
    hypotheses: tuple[Hypothesis, ...]
    gaps: dict[str, Gap]
    remaining: dict[str, Any]
    formula: dict[str, Any] | None
    """Terms that explain what has no name, if there are; the fitted rig has them."""
    next_experiment: str
    warnings: tuple[str, ...]
    fitted_rig: Rig
    json: str = field(repr=False)
    report_html: str = field(repr=False)
    validation: tuple[tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame], ...] = field(repr=False, compare=False)
    """Each validation record as measured, and as simulated with the nominal and with the fitted rig."""

    def to_frame(self) -> pd.DataFrame:
        """The parameters of the named effects, a row for each."""
        columns = ["effect", "form", "probability", "parameter", "value", "low", "high", "unit"]
        rows = [
            (effect.name, effect.form, effect.probability, key, own.value, *own.ci95, own.unit)
            for effect in self.effects
            for key, own in effect.parameters.items()
        ]
        return pd.DataFrame(rows, columns=columns)

    def gap_frame(self) -> pd.DataFrame:
        """The gap of each signal, a row for each."""
        rows = {name: (own.before, own.after, own.noise, own.removed) for name, own in self.gaps.items()}
        columns = ["before", "after", "noise", "removed"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns)

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict}"]
        for effect in self.effects:
            names = " or ".join((effect.name, *effect.alternatives))
            lines.append(f"{names}: probability {effect.probability:.3f}")
            for key, own in effect.parameters.items():
                low, high = own.ci95
                lines.append(f"  {key} = {own.value:.4g} ({low:.4g} to {high:.4g}) {own.unit}")
        for name, own in self.gaps.items():
            lines.append(f"{name}: {own.before:.4g} -> {own.after:.4g}, noise {own.noise:.4g}")
        lines += [f"warning: {warning}" for warning in self.warnings]
        return "\n".join(lines)

    def plot(self, record: int = 0) -> Any:
        """Plots a validation record beside both simulations; needs matplotlib. Returns the figure."""
        measured, nominal, fitted = self.validation[record]
        runs = [("measured", measured, "k", "-"), ("nominal rig", nominal, "C1", "--"), ("fitted rig", fitted, "C2", "--")]
        return _plot(runs, list(self.gaps))


@dataclass(frozen=True)
class Simulation:
    """A record as the rig makes it of the inputs of ``drive``, and its gaps to what was measured."""

    record: pd.DataFrame
    gaps: pd.DataFrame
    json: str = field(repr=False)
    drive: pd.DataFrame = field(repr=False, compare=False)

    def plot(self) -> Any:
        """Plots the simulation beside what was measured; needs matplotlib. Returns the figure."""
        runs = [("measured", self.drive, "k", "-"), ("simulated", self.record, "C1", "--")]
        return _plot(runs, [name for name in _SIGNALS if name in self.record])


@dataclass(frozen=True)
class Check:
    """Whether a record is fit for a diagnosis: the command's JSON."""

    sampling: dict[str, Any]
    signals: pd.DataFrame
    errors: tuple[dict[str, Any], ...]
    warnings: tuple[dict[str, Any], ...]
    subsystems: pd.DataFrame
    left_out: tuple[str, ...]
    json: str = field(repr=False)


@dataclass(frozen=True)
class Design:
    """The valve that a rig needs: the command's JSON."""

    values: dict[str, Any]
    json: str = field(repr=False)


@dataclass(frozen=True)
class EffectKind:
    """An effect of the catalogue: its signature, its forms with equations, keys and the lines for a rig file."""

    name: str
    subsystem: str
    signature: str
    test_signal: str
    compensation: str
    forms: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Experiment:
    """A test signal, for a board or a simulation."""

    record: pd.DataFrame
    values: dict[str, Any]
    json: str = field(repr=False)


def _read(record: Record) -> pd.DataFrame:
    if isinstance(record, (str, os.PathLike)):
        return pd.read_csv(record)
    return record if isinstance(record, pd.DataFrame) else pd.DataFrame(dict(record))


def check(record: Record, rig: Rig | str | os.PathLike | None = None, *, accept: bool = False) -> Check:
    """Checks whether ``record`` is fit for a diagnosis of ``rig``.

    What makes a diagnosis impossible is in ``errors``; with ``accept`` numbers that cannot be in the units
    that their names say are warnings.
    """
    text = _native.check(_record(record, "record"), None if rig is None else _rig(rig), accept)
    found = _json.loads(text)
    return Check(
        sampling=found["sampling"],
        signals=pd.DataFrame(found["signals"]),
        errors=tuple(found["errors"]),
        warnings=tuple(found["warnings"]),
        subsystems=pd.DataFrame(found["blocks"]),
        left_out=tuple(found["left_out"]),
        json=text,
    )


def simulate(
    rig: Rig | str | os.PathLike,
    drive: Record,
    *,
    tolerance: float | None = None,
    accept: bool = False,
) -> Simulation:
    """Simulates ``rig`` with the inputs of ``drive``; ``tolerance`` is the permitted local error per step."""
    text, columns = _native.simulated(_rig(rig), _record(drive, "drive"), tolerance, accept)
    return Simulation(_frame(columns), pd.DataFrame(_json.loads(text)), text, _read(drive))


def diagnose(
    rig: Rig | str | os.PathLike,
    fit: Iterable[Record],
    validate: Iterable[Record],
    *,
    without: Iterable[str] = (),
    cost_wrong_name: float = 9.0,
    cost_missing_name: float = 1.0,
    threads: int | None = None,
    exact: bool = False,
    accept: bool = False,
    progress: Progress | None = None,
) -> Diagnosis:
    """Finds the effect that is missing from ``rig``, with the records ``fit``, and proves it on ``validate``.

    ``without`` leaves effects out of the catalogue; the costs say what a wrong and a missing name cost you;
    ``exact`` takes a rig without tolerances as exact. ``progress`` is called as the work goes on, from this
    thread. Ctrl-C ends it.
    """
    text, rig_toml, report_html, runs = _native.diagnosed(
        _rig(rig),
        [_record(record, f"fit[{place}]") for place, record in enumerate(fit)],
        [_record(record, f"validate[{place}]") for place, record in enumerate(validate)],
        list(without),
        (cost_wrong_name, cost_missing_name),
        threads,
        exact,
        accept,
        progress,
    )
    found = _json.loads(text)
    validation = tuple(tuple(_frame(run) for run in of_record) for of_record in runs)
    return Diagnosis(
        verdict=found["verdict"],
        effects=tuple(_effect(own) for own in found["effects"]),
        hypotheses=tuple(
            Hypothesis(tuple(own["effects"]), tuple(own["unknown"]), own["probability"]) for own in found["hypotheses"]
        ),
        gaps={name: Gap(own["before"], own["after"], own["noise"], own["removed"]) for name, own in found["gap"].items()},
        remaining=found["remaining"],
        formula=found["formula"],
        next_experiment=found["next_experiment"],
        warnings=tuple(found["warnings"]),
        fitted_rig=Rig(rig_toml, "rig.fitted.toml"),
        json=text,
        report_html=report_html,
        validation=validation,
    )


def design(
    rig: Rig | str | os.PathLike | None = None,
    *,
    pressure_pa_min: float | None = None,
    pressure_pa_max: float | None = None,
    masses_kg: Iterable[float] = (),
    accept: bool = False,
) -> Design:
    """Computes the valve that ``rig`` needs; of the paper's rig without one."""
    text = _native.design(
        None if rig is None else _rig(rig), pressure_pa_min, pressure_pa_max, list(masses_kg), accept
    )
    return Design(_json.loads(text), text)


def effects(name: str | None = None, *, rig: Rig | str | os.PathLike | None = None) -> list[EffectKind]:
    """The effects that a rig may have, or the one of that name; with those that ``rig`` declares itself."""
    found = _json.loads(_native.effects(name, None if rig is None else _rig(rig)))
    kinds = found if name is None else [found]
    return [EffectKind(**{**kind, "forms": tuple(kind["forms"])}) for kind in kinds]


def experiment(
    rig: Rig | str | os.PathLike,
    parts: Iterable[str] = (),
    *,
    contraction_max: float | None = None,
    rate_pa_per_s_max: float | None = None,
    accept: bool = False,
) -> Experiment:
    """Writes the test signal of the next experiment within the limits of ``rig``: of ``parts``, or all but
    ``shut-holds``."""
    text, columns = _native.experiment(_rig(rig), list(parts), contraction_max, rate_pa_per_s_max, accept)
    return Experiment(_frame(columns), _json.loads(text), text)


_SIGNALS = {
    "pressure_pa": ("gauge pressure", "kPa", 1e-3),
    "contraction": ("contraction", "%", 100.0),
    "force_n": ("force", "N", 1.0),
}


def _plot(runs: list[tuple[str, pd.DataFrame, str, str]], signals: list[str]) -> Any:
    import matplotlib.pyplot as plt

    shown = [name for name in _SIGNALS if name in signals]
    figure, axes = plt.subplots(len(shown), 1, sharex=True, squeeze=False, figsize=(8, 2.4 * len(shown)))
    for axis, signal in zip(axes[:, 0], shown):
        name, unit, factor = _SIGNALS[signal]
        for label, run, colour, style in runs:
            if signal in run:
                axis.plot(run["time_s"], factor * run[signal], style, color=colour, label=label, linewidth=1)
        axis.set_ylabel(f"{name} [{unit}]")
        axis.grid(alpha=0.3)
    axes[0, 0].legend(loc="upper right")
    axes[-1, 0].set_xlabel("time [s]")
    figure.tight_layout()
    return figure
