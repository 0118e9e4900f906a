"""The reference steps solved with scipy's solve_ivp, as a user writes it; JSON lines on stdout.

    python -m pip install -r requirements.txt
    python scipy_peers.py ../../reference/steps_B --repeats 5
"""

import argparse
import csv
import json
import math
import statistics
import time
import tomllib
from pathlib import Path

import numpy as np
import scipy
from scipy.integrate import solve_ivp

R, CV, CP, G_M_PER_S2 = 287.0, 718.0, 1005.0, 9.80665
METHODS = ("LSODA", "BDF", "Radau", "RK45", "DOP853")
TOLERANCES = (1e-4, 1e-5, 3e-6)
RANGES = np.array([0.25, 1.0, 4e5, 100.0])  # contraction, its rate (1/s), pressure (Pa), K
MOST_SECONDS = 20.0  # a method whose run takes longer is not tried at a finer tolerance
NEARLY_NOW_S = 1e-12  # closer to the span's end than this is at the end
# The flow counts as reversed when the pressure has passed the reference by its tolerance: in
# equilibrium solve_ivp takes zeros in a row, and noise, for crossings.
FLOW_BAND_PA = RANGES[2]  # times the tolerance
# DOP853's error estimate lets it step beyond its stability, where its interpolation is wrong
# by 1e-3; shorter steps than this cost more, longer ones are inaccurate.
LONGEST_STEP_S = {"DOP853": 7.5e-3}


class Plant:
    """Eqs 1-5 and 9, and what holds between two events."""

    def __init__(self, rig):
        self.muscle, self.load, self.valve, self.gas = (
            rig[section] for section in ("muscle", "load", "valve", "gas")
        )
        self.ambient_pa = self.gas["atmospheric_pressure_pa"]
        self.motion, self.sinkable = 0, False  # sinkable: at rest above the stop
        self.valve_pa, self.charging, self.flow_band_pa = 0.0, False, 0.0

    def net_n(self, y):
        """Muscle force less weight, before friction."""
        m = self.muscle
        area_m2 = m["alpha_m2"] * (1.0 - y[0]) ** 2 + m["beta_m2"]
        weight_n = self.load["mass_kg"] * G_M_PER_S2
        return area_m2 * (y[2] - self.ambient_pa) + m["gamma_n"] - weight_n

    def rates(self):
        """The function to integrate until the next event."""
        m, load, gas = self.muscle, self.load, self.gas
        alpha_m2, beta_m2 = m["alpha_m2"], m["beta_m2"]
        d1_m3, d2_m3, d3_m3 = m["volume_d1_m3"], m["volume_d2_m3"], m["volume_d3_m3"]
        length_m, ambient_pa = m["initial_length_m"], self.ambient_pa
        mass_length_kg_m = load["mass_kg"] * length_m
        viscous_ns = load["viscous_damping_ns_per_m"] * length_m
        opposing_n = load["mass_kg"] * G_M_PER_S2 - m["gamma_n"]
        opposing_n += load["coulomb_friction_n"] * self.motion
        flow_gain_kg_per_pa_s, valve_pa = self.valve["flow_gain_kg_per_pa_s"], self.valve_pa
        ambient_k, moves, charging = gas["ambient_temperature_k"], self.motion != 0, self.charging
        side = "charging" if charging else "discharging"
        heat_w_per_m2_k = gas[f"heat_transfer_{side}_w_per_m2_k"]
        pi_length_m, sqrt, r_per_cv, cp_per_cv = math.pi * length_m, math.sqrt, R / CV, CP / CV

        def function(_time_s, y):
            eps, rate_per_s, pressure_pa, gas_k = y.tolist()
            open_part = 1.0 - eps
            eps_rate_per_s = acceleration_per_s2 = 0.0
            if moves:
                area_m2 = alpha_m2 * open_part * open_part + beta_m2
                force_n = area_m2 * (pressure_pa - ambient_pa) - opposing_n
                acceleration_per_s2 = (force_n - viscous_ns * rate_per_s) / mass_length_kg_m
                eps_rate_per_s = rate_per_s
            volume_m3 = (d1_m3 * eps + d2_m3) * eps + d3_m3
            flow_kg_per_s = flow_gain_kg_per_pa_s * (valve_pa - pressure_pa)
            squared_m4 = pi_length_m * volume_m3 * open_part  # negative in wild trial steps
            wall_m2 = 2.0 * sqrt(squared_m4) if squared_m4 > 0.0 else 0.0
            inlet_w = CP * flow_kg_per_s * (ambient_k if charging else gas_k)
            inlet_w += heat_w_per_m2_k * wall_m2 * (ambient_k - gas_k)
            work_w = pressure_pa * (2.0 * d1_m3 * eps + d2_m3) * eps_rate_per_s
            left_w = inlet_w - work_w - CV * flow_kg_per_s * gas_k
            return (
                eps_rate_per_s,
                acceleration_per_s2,
                (r_per_cv * inlet_w - cp_per_cv * work_w) / volume_m3,
                r_per_cv * gas_k / (pressure_pa * volume_m3) * left_w,
            )

        return function

    def events(self):
        """(function, direction of its zero crossing, what to change)."""
        side = 1 if self.charging else -1
        passed_pa = self.valve_pa + side * self.flow_band_pa
        events = [(lambda _, y: passed_pa - y[2], -side, self.reverse_flow)]
        if self.motion != 0:
            events.append((lambda _, y: y[1], -self.motion, self.come_to_rest))
            if self.motion < 0:
                events.append((lambda _, y: y[0], -1, self.hit_stop))
        else:
            static_n = self.load["static_friction_n"]
            events.append((lambda _, y: self.net_n(y) - static_n, 1, self.rise))
            if self.sinkable:
                events.append((lambda _, y: self.net_n(y) + static_n, -1, self.sink))
        return events

    def reverse_flow(self, _y):
        self.charging = not self.charging

    def come_to_rest(self, y):
        y[1] = 0.0
        net_n, static_n = self.net_n(y), self.load["static_friction_n"]
        self.motion, self.sinkable = 0, y[0] > 0.0
        if net_n > static_n:
            self.motion = 1
        elif net_n < -static_n and self.sinkable:
            self.motion = -1

    def hit_stop(self, y):
        y[0] = 0.0
        self.come_to_rest(y)

    def rise(self, _y):
        self.motion = 1

    def sink(self, _y):
        self.motion = -1


def simulate(plant, case, method, tolerance):
    """Contraction and gauge pressure in each row, and the number of events."""
    time_s, reference_pa = case["time_s"], case["pressure_ref_pa"]
    initial_pa = case["pressure_pa"][0] + plant.ambient_pa
    initial_k = plant.gas["ambient_temperature_k"]
    y = np.array([case["contraction"][0], 0.0, initial_pa, initial_k])
    plant.come_to_rest(y)
    plant.flow_band_pa = FLOW_BAND_PA * tolerance
    rows, count = np.empty((len(time_s), 4)), 0
    rows[0] = y
    last = len(time_s) - 1  # the last row's reference holds for no time
    changes = [row for row in range(1, last) if reference_pa[row] != reference_pa[row - 1]]
    for first, end in zip([0, *changes], [*changes, last]):
        supply_pa = plant.valve["supply_pressure_pa"]
        plant.valve_pa = max(0.0, min(reference_pa[first], supply_pa)) + plant.ambient_pa
        plant.charging = plant.valve_pa > y[2]
        now_s, end_s, row = time_s[first], time_s[end], first + 1
        while end_s - now_s > NEARLY_NOW_S:
            events = plant.events()
            for function, direction, _ in events:
                function.terminal, function.direction = True, direction
            solution = solve_ivp(
                plant.rates(),
                (now_s, end_s),
                y,
                method=method,
                t_eval=time_s[row : end + 1],
                max_step=LONGEST_STEP_S.get(method, math.inf),
                events=[function for function, *_ in events],
                rtol=tolerance,
                atol=tolerance * RANGES,
            )
            if not solution.success:
                raise RuntimeError(f"{method}, {tolerance}: {solution.message}")
            done = len(solution.t)
            if done > 0:
                rows[row : row + done] = solution.y.T
                row += done
            if solution.status == 0:
                y = rows[end].copy()
                break
            for times_s, states, (_, _, change) in zip(
                solution.t_events, solution.y_events, events
            ):
                if len(times_s) > 0:
                    now_s, y = times_s[0], states[0].copy()
                    change(y)
                    count += 1
        rows[row : end + 1] = y  # when an event came just before the last row
    return rows[:, 0], rows[:, 2] - plant.ambient_pa, count


def read_columns(path):
    with path.open(newline="") as file:
        header, *lines = csv.reader(file)
    return {
        name: np.array([float(cell or "nan") for cell in column])
        for name, column in zip(header, zip(*lines))
    }


def error(values, expected):
    """Largest deviation, relative to the expected values' range."""
    return float(np.abs(values - expected).max() / np.ptp(expected))


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("case_folder", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    arguments = parser.parse_args()
    folder = arguments.case_folder
    plant = Plant(tomllib.loads((folder / "rig.toml").read_text()))
    expected = read_columns(folder / "expected.csv")
    drive = read_columns(folder / "drive.csv")
    case = {**expected, "pressure_ref_pa": drive["pressure_ref_pa"]}
    for method in arguments.methods:
        for tolerance in TOLERANCES:
            seconds = []
            for _ in range(arguments.repeats):
                start_s = time.perf_counter()
                contraction, pressure_pa, events = simulate(plant, case, method, tolerance)
                seconds.append(time.perf_counter() - start_s)
            line = {
                "solver": f"scipy {method} {scipy.__version__}",
                "language": "Python",
                "tolerance": tolerance,
                "seconds": round(statistics.median(seconds), 4),
                "simulated_s": float(expected["time_s"][-1] - expected["time_s"][0]),
                "error_contraction": float(f"{error(contraction, expected['contraction']):.3e}"),
                "error_pressure": float(f"{error(pressure_pa, expected['pressure_pa']):.3e}"),
                "events": events,
            }
            print(json.dumps(line), flush=True)
            if line["seconds"] > MOST_SECONDS:
                break


if __name__ == "__main__":
    main()
