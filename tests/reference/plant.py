"""The muscle plant's equations (Eqs 1-5 and 9), integrated by scipy from event to event.

State: contraction, its rate (1/s), mass of the gas (g), its internal energy (J). Between events the
equations are smooth; every event (sticking, breaking away, the stop, the flow's reversal) ends an
integration and starts the next.
"""

import math
import tomllib
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

R, CV, CP, G_M_PER_S2 = 287.0, 718.0, 1005.0, 9.80665
MAX_STEP_S = 2e-3
FLOW_BAND_PA = 1e-3  # the flow counts as reversed this far beyond zero pressure difference


class Line(NamedTuple):
    """A quantity linear in time."""

    start_s: float
    value: float
    slope: float

    def at(self, time_s):
        return self.value + self.slope * (time_s - self.start_s)


class Initial(NamedTuple):
    """State in the first row; the contraction is ignored where it is an input."""

    pressure_pa: float
    contraction: float = 0.0
    rate_per_s: float = 0.0
    temperature_k: float = 293.0


class Plant:
    """Eqs 1-5 and 9 for one rig, with the inputs of one span of time between two rows."""

    def __init__(self, rig):
        self.muscle, self.load = rig["muscle"], rig["load"]
        self.valve, self.gas = rig.get("valve"), rig.get("gas")
        self.length_m = self.muscle["initial_length_m"]
        self.moves = self.load["kind"] == "weight"
        self.motion, self.charging = 0, True
        self.reference_pa = self.supply = self.pressure = self.contraction = None

    def volume_m3(self, eps):
        m = self.muscle
        return (m["volume_d1_m3"] * eps + m["volume_d2_m3"]) * eps + m["volume_d3_m3"]

    def volume_slope_m3(self, eps):
        return 2.0 * self.muscle["volume_d1_m3"] * eps + self.muscle["volume_d2_m3"]

    def pull_n(self, gauge_pa, eps):
        """Eq 1."""
        m = self.muscle
        area_m2 = m["alpha_m2"] * (1.0 - eps) ** 2 + m["beta_m2"]
        return area_m2 * gauge_pa + m["gamma_n"]

    def eps_and_rate(self, time_s, y):
        if self.contraction is not None:
            return self.contraction.at(time_s), self.contraction.slope
        return y[0], y[1]

    def gauge_pa(self, time_s, y):
        if self.pressure is not None:
            return self.pressure.at(time_s)
        eps, _ = self.eps_and_rate(time_s, y)
        return R * y[3] / (CV * self.volume_m3(eps)) - self.gas["atmospheric_pressure_pa"]

    def net_n(self, time_s, y):
        """Muscle force less weight, before friction."""
        eps, _ = self.eps_and_rate(time_s, y)
        return self.pull_n(self.gauge_pa(time_s, y), eps) - self.load["mass_kg"] * G_M_PER_S2

    def gap_pa(self, time_s, y):
        """Limited reference less pressure: the flow is K_G times this."""
        limited_pa = max(0.0, min(self.reference_pa, self.supply.at(time_s)))
        return limited_pa - self.gauge_pa(time_s, y)

    def heat_area_k_m2(self, eps, y):
        """S_h (theta_a - theta)."""
        area_m2 = 2.0 * math.sqrt(math.pi * self.volume_m3(eps) * self.length_m * (1.0 - eps))
        return area_m2 * (self.gas["ambient_temperature_k"] - temperature_k(y))

    def derivative(self, time_s, y):
        eps, rate_per_s = self.eps_and_rate(time_s, y)
        acceleration = mass_flow_g = power_w = 0.0
        if self.motion != 0:
            friction_n = self.load["coulomb_friction_n"] * self.motion
            friction_n += self.load["viscous_damping_ns_per_m"] * self.length_m * rate_per_s
            mass_length = self.load["mass_kg"] * self.length_m
            acceleration = (self.net_n(time_s, y) - friction_n) / mass_length
        if self.pressure is None:
            flow_kg_per_s = self.valve["flow_gain_kg_per_pa_s"] * self.gap_pa(time_s, y)
            inflow_k = self.gas["ambient_temperature_k"]
            enthalpy_k = inflow_k if flow_kg_per_s > 0.0 else temperature_k(y)
            absolute_pa = R * y[3] / (CV * self.volume_m3(eps))
            power_w = CP * enthalpy_k * flow_kg_per_s
            power_w -= absolute_pa * self.volume_slope_m3(eps) * rate_per_s
            side = "charging" if self.charging else "discharging"
            heat_w_per_m2_k = self.gas[f"heat_transfer_{side}_w_per_m2_k"]
            power_w += heat_w_per_m2_k * self.heat_area_k_m2(eps, y)
            mass_flow_g = 1e3 * flow_kg_per_s
        return [y[1] if self.motion != 0 else 0.0, acceleration, mass_flow_g, power_w]

    def motion_from_rest(self, time_s, y):
        net_n, static_n = self.net_n(time_s, y), self.load["static_friction_n"]
        if net_n > static_n:
            return 1
        return -1 if net_n < -static_n and y[0] > 0.0 else 0

    def events(self, state):
        """(function, direction of its zero crossing, name, what to change)."""
        events = []
        if self.moves and self.motion != 0:
            events.append((lambda t, y: y[1], -self.motion, "rest", self.come_to_rest))
            if self.motion < 0:
                events.append((lambda t, y: y[0], -1, "stop", self.hit_stop))
        elif self.moves:
            static_n = self.load["static_friction_n"]
            events.append((lambda t, y: self.net_n(t, y) - static_n, 1, "breakaway", self.rise))
            if state[0] > 0.0:
                events.append(
                    (lambda t, y: self.net_n(t, y) + static_n, -1, "breakaway", self.sink)
                )
        if self.pressure is None:
            band_pa = FLOW_BAND_PA if self.charging else -FLOW_BAND_PA
            direction = -1 if self.charging else 1
            events.append(
                (lambda t, y: self.gap_pa(t, y) + band_pa, direction, "flow", self.reverse_flow)
            )
        return events

    def come_to_rest(self, time_s, y):
        y[1] = 0.0
        self.motion = self.motion_from_rest(time_s, y)

    def hit_stop(self, time_s, y):
        y[0] = 0.0
        self.come_to_rest(time_s, y)

    def rise(self, _time_s, _y):
        self.motion = 1

    def sink(self, _time_s, _y):
        self.motion = -1

    def reverse_flow(self, _time_s, _y):
        self.charging = not self.charging

    def advance(self, start_s, end_s, y, solver, counts):
        """State at the end of a span in which every input is smooth."""
        if self.pressure is None and abs(gap_pa := self.gap_pa(start_s, y)) > FLOW_BAND_PA:
            self.charging = gap_pa > 0.0
        while start_s < end_s:
            events = self.events(y)
            for function, direction, *_ in events:
                function.terminal, function.direction = True, direction
            functions = [function for function, *_ in events]
            span_s = (start_s, end_s)
            solution = solve_ivp(
                self.derivative, span_s, y, events=functions, max_step=MAX_STEP_S, **solver
            )
            if not solution.success:
                raise RuntimeError(f"at {start_s} s: {solution.message}")
            start_s, y = solution.t[-1], solution.y[:, -1].copy()
            for times_s, (_, _, name, change) in zip(solution.t_events, events):
                if len(times_s) > 0:
                    change(start_s, y)
                    counts[name] = counts.get(name, 0) + 1
        return y


def temperature_k(y):
    return 1e3 * y[3] / (CV * y[2])


def simulate(rig_toml, columns, initial, solver, reference_of=None):
    """Row values of one run, and how often each event happened.

    `reference_of(row, contraction)` closes the loop: it is called in each row, and its answer
    becomes the row's reference.
    """
    rig = tomllib.loads(rig_toml)
    plant, counts, rows = Plant(rig), {}, []
    time_s, inputs = columns["time_s"], dict(columns)
    if plant.valve is not None and "supply_pa" not in inputs:
        inputs["supply_pa"] = np.full(len(time_s), plant.valve["supply_pressure_pa"])
    y = None
    for row, now_s in enumerate(time_s):
        next_row = min(row + 1, len(time_s) - 1)
        span_s = time_s[next_row] - now_s
        lines = {
            name: Line(now_s, column[row], (column[next_row] - column[row]) / (span_s or 1.0))
            for name, column in inputs.items()
        }
        plant.supply = lines.get("supply_pa")
        plant.pressure, plant.contraction = lines.get("pressure_pa"), lines.get("contraction")
        if y is None:
            y = initial_state(plant, initial, now_s)
        if plant.valve is not None:
            if reference_of is not None:
                inputs["pressure_ref_pa"][row] = reference_of(row, y[0])
            plant.reference_pa = inputs["pressure_ref_pa"][row]
        eps, _ = plant.eps_and_rate(now_s, y)
        gauge_pa = plant.gauge_pa(now_s, y)
        gas_k = temperature_k(y) if plant.valve is not None else math.nan
        rows.append((now_s, gauge_pa, eps, plant.pull_n(gauge_pa, eps), gas_k, y[1]))
        if next_row > row:
            corner_s = supply_corner_s(plant, now_s, time_s[next_row])
            for start_s, end_s in zip(corner_s, corner_s[1:]):
                y = plant.advance(start_s, end_s, y, solver, counts)
    names = ("time_s", "pressure_pa", "contraction", "force_n", "temperature_k", "rate_per_s")
    return dict(zip(names, np.array(rows).T)), counts


def initial_state(plant, initial, time_s):
    """Sets the plant's motion too."""
    y = np.array([initial.contraction, initial.rate_per_s, 0.0, 0.0])
    if plant.valve is not None:
        eps, _ = plant.eps_and_rate(time_s, y)
        absolute_pa = initial.pressure_pa + plant.gas["atmospheric_pressure_pa"]
        y[3] = CV / R * absolute_pa * plant.volume_m3(eps)
        y[2] = 1e3 * y[3] / (CV * initial.temperature_k)
    if plant.moves:
        plant.motion = int(np.sign(y[1])) or plant.motion_from_rest(time_s, y)
    return y


def supply_corner_s(plant, start_s, end_s):
    """The span's ends, and between them the time when the supply crosses the reference."""
    if plant.supply is None or plant.supply.slope == 0.0:
        return [start_s, end_s]
    cross_s = start_s + (plant.reference_pa - plant.supply.value) / plant.supply.slope
    return [start_s, cross_s, end_s] if start_s < cross_s < end_s else [start_s, end_s]
