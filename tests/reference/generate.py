"""Reference solutions of the muscle plant's equations, a directory for each case. See README.md."""

import math
import sys
import tomllib
from dataclasses import dataclass
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from plant import G_M_PER_S2, Initial, simulate

HERE = Path(__file__).resolve().parent
FINE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
CHECK = {"method": "Radau", "rtol": 1e-9, "atol": 1e-12}
OBSERVED_S = 1.0  # the simulated quantities are in drive.csv for this long

MUSCLE_TOML = """schema = 1

[muscle]
alpha_m2 = 3.7718e-3
beta_m2 = -1.39e-3
gamma_n = -183.0
volume_d1_m3 = -9.90e-4
volume_d2_m3 = 7.005e-4
volume_d3_m3 = 2.30e-5
initial_length_m = 0.3
"""
WEIGHT_TOML = """
[load]
kind = "weight"
mass_kg = 12.0
viscous_damping_ns_per_m = 45.0
coulomb_friction_n = 4.5
static_friction_n = 7.0
"""
PRESCRIBED_TOML = """
[load]
kind = "prescribed"
"""
GAS_TOML = """
[valve]
flow_gain_kg_per_pa_s = {flow_gain}
supply_pressure_pa = 5.0e5

[gas]
ambient_temperature_k = 293.0
atmospheric_pressure_pa = 101325.0
heat_transfer_charging_w_per_m2_k = 120.0
heat_transfer_discharging_w_per_m2_k = 80.0
"""
ASSIST_TOML = """
[assist]
gain = 20.0
input_stiffness_n_per_m = 200.0
lever_length_m = 0.3
pulley_diameter_m = 0.1
"""
GAS_A_TOML, GAS_B_TOML = GAS_TOML.format(flow_gain="6.1e-9"), GAS_TOML.format(flow_gain="1.3e-7")


@dataclass
class Case:
    """One rig, the inputs in each row, and the state in the first row."""

    exercises: str
    rig_toml: str
    columns: dict
    initial: Initial
    temperature_observed: bool = False


def as_written(values):
    """Values as drive.csv will hold them, so that the inputs simulated are the inputs read."""
    return np.array([float(f"{value:.8g}") for value in values])


def row_times_s(end_s, row_s=0.01):
    return as_written(np.arange(round(end_s / row_s) + 1) * row_s)


def steps(time_s, schedule):
    """Values of [(from time, value)...], each held until the next."""
    from_s, values = zip(*schedule)
    return np.array(values, float)[np.searchsorted(from_s, time_s + 1e-9) - 1]


def weight_case(exercises, gas_toml, time_s, reference_pa, initial, **more_columns):
    columns = {"time_s": time_s, "pressure_ref_pa": as_written(reference_pa), **more_columns}
    return Case(exercises, MUSCLE_TOML + WEIGHT_TOML + gas_toml, columns, initial)


def at_rest(pressure_pa):
    """The contraction at which the weight hangs in balance at this pressure."""
    muscle = tomllib.loads(MUSCLE_TOML)["muscle"]
    weight_n = tomllib.loads(WEIGHT_TOML)["load"]["mass_kg"] * G_M_PER_S2
    area_m2 = (weight_n - muscle["gamma_n"]) / pressure_pa
    contraction = 1.0 - math.sqrt((area_m2 - muscle["beta_m2"]) / muscle["alpha_m2"])
    return Initial(pressure_pa, contraction)


def step_case(gas_toml):
    levels_kpa = [100, 250, 400, 150, 50, 200, 450, 300, 350, 120, 50, 360, 180, 220, 90, 380]
    durations_s = [0.3, 0.5, 0.6, 0.4, 0.7, 0.3, 0.8, 0.3, 0.4, 0.3, 1.0, 0.5, 0.3, 0.4, 0.9, 1.0]
    from_s = np.concatenate([[0.0], np.cumsum(durations_s)[:-1]])
    time_s = row_times_s(8.0)
    reference_pa = steps(time_s, zip(from_s, 1e3 * np.array(levels_kpa)))
    exercises = "reference steps 50-450 kPa; down onto the stop and off again"
    return weight_case(exercises, gas_toml, time_s, reference_pa, Initial(1e5))


def multisine_pa(time_s):
    frequencies_hz = np.array([0.1, 0.3, 0.7, 1.3, 2.1, 3.7, 5.3, 8.0])
    phases_rad = 2.0 * math.pi * np.array([0.0, 0.21, 0.55, 0.83, 0.37, 0.69, 0.12, 0.48])
    swing = np.sin(2.0 * math.pi * np.outer(time_s, frequencies_hz) + phases_rad).sum(axis=1)
    return 250e3 + 120e3 * swing / np.abs(swing).max()


def multisine_case():
    time_s = row_times_s(8.0)
    exercises = "eight sines 0.1-8 Hz: fast motion, thermal cycling, sticking at reversals"
    return weight_case(exercises, GAS_B_TOML, time_s, multisine_pa(time_s), at_rest(250e3))


def assist_case(gas_toml):
    """Runs the closed loop once; its references are the case's input."""
    time_s = row_times_s(5.0)
    moving_m = 0.06 * (1.0 - np.cos(math.pi * time_s))
    finger_m = as_written(np.where(time_s < 1.0, moving_m, 0.12))
    input_force_n, reference_pa = np.zeros(len(time_s)), np.zeros(len(time_s))
    rig_toml = MUSCLE_TOML + WEIGHT_TOML + gas_toml + ASSIST_TOML
    rig = tomllib.loads(rig_toml)
    assist, muscle, valve = rig["assist"], rig["muscle"], rig["valve"]
    finger_per_contraction_m = (
        muscle["initial_length_m"] * assist["lever_length_m"] / (2.0 * assist["pulley_diameter_m"])
    )

    def reference_of(row, eps):
        stretch_m = finger_m[row] - finger_per_contraction_m * eps
        input_force_n[row] = assist["input_stiffness_n_per_m"] * stretch_m
        wanted_n = assist["gain"] * input_force_n[row]
        area_m2 = muscle["alpha_m2"] * (1.0 - eps) ** 2 + muscle["beta_m2"]
        wanted_pa = (wanted_n - muscle["gamma_n"]) / area_m2
        return as_written([max(0.0, min(wanted_pa, valve["supply_pressure_pa"]))])[0]

    columns = {"time_s": time_s, "pressure_ref_pa": reference_pa}
    simulate(rig_toml, columns, Initial(0.0), FINE, reference_of)
    columns |= {"finger_m": finger_m, "input_force_n": as_written(input_force_n)}
    exercises = "references of the closed loop (Eqs 6-8, 10 ms), from the stop without pressure"
    return Case(exercises, rig_toml, columns, Initial(0.0))


def prescribed_fill_case():
    time_s = row_times_s(4.0)
    sine = 0.1 * (1.0 - np.cos(math.pi * time_s))
    triangle = 0.2 * (1.0 - np.abs(time_s - 3.0))
    schedule = [(0, 1e5), (0.4, 3e5), (0.9, 4.5e5), (1.5, 1e5), (2.2, 4e5), (2.8, 5e4), (3.3, 3e5)]
    columns = {
        "time_s": time_s,
        "pressure_ref_pa": steps(time_s, schedule),
        "contraction": as_written(np.where(time_s < 2.0, sine, triangle)),
    }
    exercises = "contraction moved as sine, then triangle, while the valve steps"
    return Case(exercises, MUSCLE_TOML + PRESCRIBED_TOML + GAS_B_TOML, columns, Initial(1e5))


def pressure_input_case():
    time_s = row_times_s(5.0, 0.005)
    slow = 0.5 - 0.5 * np.cos(2.0 * math.pi * 0.4 * time_s)
    fast = np.sin(2.0 * math.pi * 0.4 * time_s) ** 2 * np.sin(2.0 * math.pi * 3.0 * time_s)
    columns = {"time_s": time_s, "pressure_pa": as_written(1e5 + 3e5 * (0.85 * slow + 0.1 * fast))}
    exercises = "pressure is the input: no valve, no gas; the weight alone"
    return Case(exercises, MUSCLE_TOML + WEIGHT_TOML, columns, Initial(1e5))


def prescribed_pressure_case():
    time_s = row_times_s(2.0)
    columns = {
        "time_s": time_s,
        "pressure_pa": as_written(2.5e5 - 2e5 * np.cos(2.0 * math.pi * 0.7 * time_s)),
        "contraction": as_written(0.12 - 0.12 * np.cos(2.0 * math.pi * 1.1 * time_s)),
    }
    exercises = "both are inputs: Eq 1 alone"
    return Case(exercises, MUSCLE_TOML + PRESCRIBED_TOML, columns, Initial(5e4))


def start_in_motion_case():
    """The rest of a multisine run, from the row where the weight is fastest."""
    run = multisine_case()
    rows, _ = simulate(run.rig_toml, run.columns, run.initial, FINE)
    time_s = run.columns["time_s"]
    early = (time_s > 1.0) & (time_s < 4.0)
    first = int(np.argmax(np.where(early, np.abs(rows["rate_per_s"]), 0.0)))
    keep = slice(first, first + 401)
    names = ("pressure_pa", "contraction", "rate_per_s", "temperature_k")
    columns = {name: column[keep] for name, column in run.columns.items()}
    initial = Initial(*(float(rows[name][first]) for name in names))
    exercises = "begins with the weight in fast motion and the gas not at ambient"
    return Case(exercises, run.rig_toml, columns, initial, temperature_observed=True)


def uneven_rows_case():
    spacing_s = np.random.default_rng(3).uniform(0.002, 0.040, 300)
    time_s = as_written(np.round(np.concatenate([[0.0], np.cumsum(spacing_s)]), 4))
    schedule = [(0, 1.5e5), (0.5, 3e5), (1.3, 2e5), (1.9, 4e5), (2.9, 3.2e5), (3.6, 6e4)]
    schedule += [(4.4, 2.7e5), (5.2, 4.3e5)]
    exercises = "rows 2-40 ms apart: the reference holds until the next row"
    return weight_case(exercises, GAS_B_TOML, time_s, steps(time_s, schedule), at_rest(2e5))


def creep_steps_case():
    time_s = row_times_s(12.0)
    up_and_down = 15.0 - np.abs(np.floor((time_s + 1e-9) / 0.2) - 30.0)
    exercises = "stairs of 2 kPa every 0.2 s, 220-280 kPa: sticks and breaks away"
    return weight_case(exercises, GAS_B_TOML, time_s, 250e3 + 2e3 * up_and_down, at_rest(220e3))


def held_supply_case():
    time_s = row_times_s(4.0)
    supply_pa = as_written(np.interp(time_s, [1.0, 3.005], [5e5, 3.8e5]))
    reference_pa = steps(time_s, [(0, 3e5), (0.5, 4.5e5)])
    exercises = "supply falls 500-380 kPa below a reference of 450 kPa"
    initial = at_rest(3e5)
    return weight_case(exercises, GAS_B_TOML, time_s, reference_pa, initial, supply_pa=supply_pa)


CASES = {
    "steps_A": lambda: step_case(GAS_A_TOML),
    "steps_B": lambda: step_case(GAS_B_TOML),
    "multisine_B": multisine_case,
    "assist_A": lambda: assist_case(GAS_A_TOML),
    "assist_B": lambda: assist_case(GAS_B_TOML),
    "prescribed_fill": prescribed_fill_case,
    "pressure_input_weight": pressure_input_case,
    "prescribed_pressure": prescribed_pressure_case,
    "start_in_motion": start_in_motion_case,
    "uneven_rows": uneven_rows_case,
    "creep_steps": creep_steps_case,
    "held_supply": held_supply_case,
}


def write_csv(path, columns, digits):
    """NaN is an empty cell."""
    lines = [",".join(columns)]
    for row in zip(*columns.values()):
        lines.append(",".join("" if math.isnan(value) else f"{value:.{digits}g}" for value in row))
    path.write_text("\n".join(lines) + "\n")


def generate(name):
    """Writes one case; returns its line of the README's table."""
    case = CASES[name]()
    rows, counts = simulate(case.rig_toml, case.columns, case.initial, FINE)
    check, _ = simulate(case.rig_toml, case.columns, case.initial, CHECK)
    expected = {key: rows[key] for key in ("time_s", "pressure_pa", "contraction", "force_n")}
    if "pressure_ref_pa" in case.columns:
        expected["temperature_k"] = rows["temperature_k"]

    time_s, drive = case.columns["time_s"], dict(case.columns)
    observed = ["pressure_pa", "contraction"] + ["temperature_k"] * case.temperature_observed
    for key in observed:
        if key not in drive:
            drive[key] = np.where(time_s - time_s[0] <= OBSERVED_S + 1e-9, rows[key], np.nan)

    directory = HERE / name
    directory.mkdir(exist_ok=True)
    (directory / "rig.toml").write_text(case.rig_toml)
    write_csv(directory / "drive.csv", drive, digits=8)
    write_csv(directory / "expected.csv", expected, digits=9)

    agreement = " | ".join(
        f"{np.abs(check[key] - rows[key]).max() / np.ptp(rows[key]):.1e}"
        for key in ("pressure_pa", "contraction", "force_n")
    )
    events = ", ".join(f"{count} {event}" for event, count in sorted(counts.items())) or "none"
    return f"| {name} | {case.exercises} | {events} | {agreement} |"


def main():
    with Pool() as pool:
        for line in pool.imap(generate, sys.argv[1:] or CASES, chunksize=1):
            print(line, flush=True)


if __name__ == "__main__":
    main()
