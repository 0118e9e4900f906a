"""Compares FMUs in FMPy with `hil-sim simulate`: compare.py HIL_SIM WORK_FOLDER

For the rigs and records of tests/reference, and for each effect of the catalogue switched on in the
FMU of the paper's rig, each signal must be the same to 1e-6 of its range, and FMPy's validator must
find nothing. Prints the largest deviation of each case.
"""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

PERMITTED = 1e-6  # of the signal's range
SIGNALS = ["pressure_pa", "contraction", "force_n", "temperature_k"]
REFERENCE = Path(__file__).parent.parent / "reference"


def run(*command):
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout


def read(path):
    """The columns of a record; NaN where a cell is empty."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: numpy.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def rates(time_s, values):
    return numpy.append(numpy.diff(values) / numpy.diff(time_s), 0.0)


def inputs(record, variables):
    """The inputs of an FMU at each row, by name."""
    time_s, found = record["time_s"], {}
    for name, rate, column in [
        ("supply_pa", "supply_rate_pa_per_s", "supply_pa"),
        ("prescribed_pressure_pa", "prescribed_pressure_rate_pa_per_s", "pressure_pa"),
        ("prescribed_contraction", "prescribed_contraction_rate_per_s", "contraction"),
    ]:
        if name in variables and column in record:
            found[name], found[rate] = record[column], rates(time_s, record[column])
    if "pressure_ref_pa" in variables:
        found["pressure_ref_pa"] = record["pressure_ref_pa"]
    if "valve_open" in variables and "valve_open" in record:
        found["valve_open"] = record["valve_open"] != 0
    return found


class Fmu:
    """An FMU that is loaded once and simulated often: FMPy unloads the library with the instance."""

    def __init__(self, path):
        problems = validate_fmu(str(path))
        assert not problems, f"{path}: {problems}"
        self.description = read_model_description(str(path))
        self.variables = {one.name: one for one in self.description.modelVariables}
        self.messages = []
        self.instance = FMU3Slave(
            guid=self.description.guid,
            unzipDirectory=extract(str(path)),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="rig",
        )
        self.instance.instantiate(logMessage=lambda _, status, category, message: self.messages.append(message.decode()))

    def set(self, name, value):
        variable = self.variables[name]
        set_value = self.instance.setBoolean if variable.type == "Boolean" else self.instance.setFloat64
        set_value([variable.valueReference], [value])

    def simulate(self, record, **changed):
        """The outputs at the record's times, one communication step a row."""
        time_s, moving = record["time_s"], inputs(record, self.variables)
        rows = []
        fmu = self.instance
        fmu.reset()
        for name, value in changed.items():
            self.set(name, value)
        fmu.enterInitializationMode(startTime=time_s[0])
        references = [self.variables[name].valueReference for name in SIGNALS]
        for row in range(len(time_s)):
            for name, values in moving.items():
                self.set(name, values[row])
            if row == 0:
                fmu.exitInitializationMode()
            rows.append(fmu.getFloat64(references))
            if row + 1 < len(time_s):
                fmu.doStep(time_s[row], time_s[row + 1] - time_s[row])
        fmu.terminate()
        return dict(zip(SIGNALS, numpy.array(rows).T))


def deviations(found, expected):
    """The largest deviation of each signal that is in both, in its range."""
    largest = {}
    for name in SIGNALS:
        if name in expected and name in found:
            values = expected[name]
            scale = numpy.ptp(values) or numpy.max(numpy.abs(values)) or 1.0
            largest[name] = float(numpy.max(numpy.abs(found[name] - values)) / scale)
    return largest


def check(case, found, expected):
    largest = deviations(found, expected)
    print(f"{case}: " + ", ".join(f"{name} {value:.1e}" for name, value in largest.items()))
    assert len(largest) >= 3 and max(largest.values()) <= PERMITTED, case
    return largest


def expected(hil_sim, folder, rig, drive):
    run(hil_sim, "-q", "simulate", "--rig", rig, "--drive", drive, "--out", folder / "sim.csv")
    return read(folder / "sim.csv")


def reference_cases(hil_sim, folder):
    """The inputs of a record, and the initial state that it measured."""
    for case in sorted(path for path in REFERENCE.iterdir() if path.is_dir()):
        rig, drive, record = case / "rig.toml", case / "drive.csv", read(case / "drive.csv")
        if "pressure_ref_pa" not in record:
            # Without a valve the FMU takes the pressure.
            rig = without_valve(rig, folder / "rig.toml")
        run(hil_sim, "-q", "export", "--fmu", folder / "rig.fmu", rig, "--drive", drive)
        found = Fmu(folder / "rig.fmu").simulate(record)
        check(case.name, found, expected(hil_sim, folder, case / "rig.toml", drive))


def without_valve(rig, path):
    sections = rig.read_text().split("\n[")
    path.write_text("\n[".join(section for section in sections if not section.startswith("valve]")))
    return path


def write_drive(path):
    """Rest at zero pressure, steps up to 488 kPa of the supply's 500 and down, a sine, and a shut valve: 40 s without measurements."""
    time_s = numpy.arange(4001) / 100.0
    reference_pa = numpy.select(
        [time_s < 1, time_s < 10, time_s < 20], [0.0, 1.22e5 * (1 + time_s // 1.5 % 4), 2.5e5], 1.5e5
    )
    reference_pa += numpy.where((time_s >= 10) & (time_s < 30), 8e4 * numpy.sin(3.0 * (time_s - 10)), 0.0)
    is_open = (time_s < 32) | (time_s >= 38)
    rows = zip(time_s.tolist(), reference_pa.tolist(), is_open.astype(int).tolist())
    lines = ["time_s,pressure_ref_pa,valve_open"] + [",".join(repr(cell) for cell in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")


def effect_cases(hil_sim, folder):
    """Each effect, switched on in an FMU without it, and once a number of the rig."""
    rig, changed_rig, drive = folder / "nominal.toml", folder / "changed.toml", folder / "drive.csv"
    rig.unlink(missing_ok=True)
    run(hil_sim, "-q", "rig", "new", rig)
    nominal = rig.read_text()
    write_drive(drive)
    record = read(drive)
    run(hil_sim, "-q", "export", "--fmu", folder / "rig.fmu", rig)
    fmu = Fmu(folder / "rig.fmu")
    plain = expected(hil_sim, folder, rig, drive)
    check("no effect", fmu.simulate(record), plain)
    for effect in json.loads(run(hil_sim, "effects", "--json")):
        form = effect["forms"][0]
        values = "".join(f"{one['key']} = {one['typical']!r}\n" for one in form["keys"])
        changed_rig.write_text(f"{nominal}\n[[effect]]\nname = \"{effect['name']}\"\n{values}")
        name = f"effect.{effect['name'].replace('-', '_')}.on"
        on = expected(hil_sim, folder, changed_rig, drive)
        check(effect["name"], fmu.simulate(record, **{name: True}), on)
        assert max(deviations(plain, on).values()) > 1e-4, f"{effect['name']} does not show in this record"
    changed_rig.write_text(nominal.replace("mass_kg = 12.0", "mass_kg = 9.5", 1))
    lighter = expected(hil_sim, folder, changed_rig, drive)
    assert max(deviations(plain, lighter).values()) > 0.01
    check("mass", fmu.simulate(record, **{"load.mass_kg": 9.5}), lighter)
    assert not fmu.messages, fmu.messages
    refused(fmu)
    as_a_user_does(folder / "rig.fmu", record, plain)


def refused(fmu):
    """An error arrives in the importer's log, with its reason."""
    fmu.instance.reset()
    try:
        fmu.set("load.mass_kg", -1.0)
        raise AssertionError("a negative mass was taken")
    except Exception as error:
        assert "fmi3SetFloat64" in str(error), error
    fmu.instance.freeInstance()
    expected = "variable `load.mass_kg`: expected a number from 0.001 to 1e5, found -1"
    assert fmu.messages == [expected], fmu.messages


def as_a_user_does(path, record, expected):
    """simulate_fmu, with a communication step of a row."""
    time_s = record["time_s"]
    signals = numpy.array(
        list(zip(time_s, record["pressure_ref_pa"], record["valve_open"] != 0)),
        dtype=[("time", float), ("pressure_ref_pa", float), ("valve_open", bool)],
    )
    step_s = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    result = simulate_fmu(
        str(path), start_time=time_s[0], stop_time=time_s[-1], output_interval=step_s, input=signals, output=SIGNALS
    )
    assert len(result) == len(time_s), (len(result), len(time_s))
    check("simulate_fmu", {name: result[name] for name in SIGNALS}, expected)


def main():
    hil_sim, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    reference_cases(hil_sim, folder)
    effect_cases(hil_sim, folder)


main()
