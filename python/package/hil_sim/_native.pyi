"""What the package's functions call: JSON as text, and columns of float64."""

from collections.abc import Callable
from typing import Any

_Columns = list[tuple[str, bytes]]

__version__: str

class BadInputError(ValueError): ...

def check(record: Any, rig: Any | None, accept: bool) -> str: ...
def simulated(rig: Any, drive: Any, tolerance: float | None, accept: bool) -> tuple[str, _Columns]: ...
def diagnosed(
    rig: Any,
    fit: list[Any],
    validate: list[Any],
    without: list[str],
    costs: tuple[float, float],
    threads: int | None,
    exact: bool,
    accept: bool,
    progress: Callable[[str, int, list[str]], None] | None,
) -> tuple[str, str, str, list[tuple[_Columns, _Columns, _Columns]]]: ...
def design(
    rig: Any | None,
    pressure_pa_min: float | None,
    pressure_pa_max: float | None,
    masses_kg: list[float],
    accept: bool,
) -> str: ...
def effects(name: str | None, rig: Any | None) -> str: ...
def experiment(
    rig: Any, parts: list[str], contraction_max: float | None, rate_pa_per_s_max: float | None, accept: bool
) -> tuple[str, _Columns]: ...
def check_rig(rig: Any, accept: bool) -> None: ...
def rig_template() -> str: ...
