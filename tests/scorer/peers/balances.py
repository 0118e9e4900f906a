"""The balances of gas, force and load in weak form, of which the residual is regressed (docs/theory.md).

A record is resampled to a uniform grid. Each balance is multiplied by bumps of compact support and integrated
by parts (Messenger & Bortz 2021), so that no measured signal is differentiated but those inside a term.
"""

import tomllib
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import savgol_filter
from scipy.sparse import csr_matrix, vstack

GAS_CONSTANT = 287.0
HEAT_CAPACITY_CP = 1005.0
HEAT_CAPACITY_CV = 718.0
GRAVITY = 9.80665
# Grid of resampled records.
GRID_S = 0.005
# Half-widths of the bumps: one that resolves a valve's lag, one over which a leak adds up.
NARROW_S = 0.15
WIDE_S = 1.5
# Time over which what is inside a term is smoothed.
SMOOTH_S = 0.08
# Slower than this in contraction per second the load may stick, and its friction is not known.
MOVING_PER_S = 0.004
# Contraction below which the load may rest on its stop.
STOP = 0.004


@dataclass(frozen=True)
class Signals:
    """A record on the grid; smoothed signals and rates are those inside terms."""

    time_s: np.ndarray
    reference_pa: np.ndarray
    pressure_pa: np.ndarray
    contraction: np.ndarray
    force_n: np.ndarray | None
    pressure_rate: np.ndarray
    speed: np.ndarray
    smooth_pressure_pa: np.ndarray
    smooth_contraction: np.ndarray
    period_s: float

    @staticmethod
    def of(record):
        """The signals of a record."""
        time = record["time_s"].to_numpy()
        period = float(np.median(np.diff(time)))
        grid = np.arange(time[0], time[-1], GRID_S)

        def on_grid(name):
            values = record[name].to_numpy()
            known = np.isfinite(values)
            if period < GRID_S:
                # Means over a grid's period, in which the noise averages out.
                total = np.concatenate([[0.0], np.cumsum(np.diff(time[known]) * values[known][:-1])])
                integral = np.interp(np.append(grid, grid[-1] + GRID_S) - GRID_S / 2, time[known], total)
                means = np.diff(integral) / GRID_S
                means[:1] = values[known][0]
                return means
            return PchipInterpolator(time[known], values[known])(grid)

        held = np.clip(np.searchsorted(time, grid + 1e-9, side="right") - 1, 0, len(time) - 1)
        pressure, contraction = on_grid("pressure_pa"), on_grid("contraction")
        smooth = Smoother(period)
        return Signals(
            time_s=grid,
            reference_pa=record["pressure_ref_pa"].to_numpy()[held],
            pressure_pa=pressure,
            contraction=contraction,
            force_n=on_grid("force_n") if "force_n" in record else None,
            pressure_rate=smooth(pressure, 1),
            speed=smooth(contraction, 1),
            smooth_pressure_pa=smooth(pressure),
            smooth_contraction=smooth(contraction),
            period_s=period,
        )

    def with_pressure(self, pressure, smooth):
        """The same with another true pressure."""
        rate = np.gradient(smooth, GRID_S)
        return replace(self, pressure_pa=pressure, smooth_pressure_pa=smooth, pressure_rate=rate)


class Smoother:
    """Local cubic fits (Savitzky & Golay 1964)."""

    def __init__(self, period_s):
        self.window = 2 * int(max(SMOOTH_S, 4 * period_s) / (2 * GRID_S)) + 1

    def __call__(self, values, derivative=0):
        return savgol_filter(values, self.window, 3, deriv=derivative, delta=GRID_S)


@dataclass(frozen=True)
class Change:
    """What an effect changes in the balances; the defaults change nothing."""

    signals: Signals | None = None
    # The flow through the valve [kg/s] instead of Eq 9, or its error instead of P_r - P [Pa].
    flow: np.ndarray | None = None
    error_pa: np.ndarray | None = None
    # Flow out of the muscle [kg/s], force that the muscle lacks [N], friction [N], heat transfer's factor.
    leak: np.ndarray | float = 0.0
    loss_n: np.ndarray | float = 0.0
    friction_n: np.ndarray | float = 0.0
    heat: float = 1.0
    # Air stored in a hose beside the muscle's [kg].
    stored: np.ndarray | float = 0.0
    rig: dict | None = None


class Balances:
    """The balances of one record with a rig."""

    def __init__(self, signals, rig_text, noise):
        self.signals, self.rig, self.noise = signals, tomllib.loads(rig_text), noise
        narrow = max(NARROW_S, 4 * signals.period_s)
        kernels = [bumps(len(signals.time_s), half) for half in (narrow, WIDE_S)]
        self.once, self.first, self.second = (vstack(own).tocsr() for own in zip(*kernels))
        self.centres = self.once @ signals.time_s
        moving = (np.abs(signals.speed) > MOVING_PER_S) & (signals.smooth_contraction > STOP)
        self.loaded = self.once @ moving > 0.9
        self.sigma = self.deviations()
        self.theta = self.temperature(self.rig, signals, 1.0)
        self.nominal_gas = self.gas(self.rig, signals, Change())

    def force(self, rig, signals):
        """Force of Eq 1 [N]."""
        muscle = rig["muscle"]
        slope = muscle["alpha_m2"] * (1 - signals.contraction) ** 2 + muscle["beta_m2"]
        return slope * signals.pressure_pa + muscle["gamma_n"]

    def slopes(self):
        """∂F/∂P [m²] and -∂F/∂ε [N] of Eq 1."""
        muscle, own = self.rig["muscle"], self.signals
        shorter = 1 - own.smooth_contraction
        return (
            muscle["alpha_m2"] * shorter**2 + muscle["beta_m2"],
            2 * muscle["alpha_m2"] * shorter * own.smooth_pressure_pa,
        )

    def error_pa(self):
        """P_r - P of Eq 9 [Pa]."""
        own, supply = self.signals, self.rig["valve"]["supply_pressure_pa"]
        return np.clip(own.reference_pa, 0, supply) - own.smooth_pressure_pa

    def rows(self, change=Change()):
        """Residuals of all balances in units of their standard deviation."""
        rig, own = change.rig or self.rig, change.signals or self.signals
        unchanged = all(getattr(change, name) is None for name in ("signals", "flow", "error_pa", "rig")) and all(
            np.isscalar(own) and own == usual
            for own, usual in ((change.leak, 0.0), (change.stored, 0.0), (change.heat, 1.0))
        )
        gas = self.nominal_gas if unchanged else self.gas(rig, own, change)
        force = self.force(rig, own) - change.loss_n
        parts = [gas]
        if own.force_n is not None:
            parts.append(self.once @ (own.force_n - force))
            force = own.force_n
        parts.append(np.where(self.loaded, self.load(rig, own, force, change.friction_n), 0.0))
        return np.concatenate(parts) / self.sigma

    def gas(self, rig, own, change):
        """Residual of the energy balance, as a flow of ambient air into the muscle [kg/s]."""
        muscle, gas = rig["muscle"], rig["gas"]
        ambient = gas["ambient_temperature_k"]
        flow = change.flow
        if flow is None:
            supply = rig["valve"]["supply_pressure_pa"]
            error = change.error_pa
            if error is None:
                error = np.clip(own.reference_pa, 0, supply) - own.pressure_pa
            flow = rig["valve"]["flow_gain_kg_per_pa_s"] * error
        total = flow - change.leak
        absolute, volume, slope, transfer = self.air(rig, own, change.heat)
        theta = self.theta
        if change.rig or change.signals or change.heat != 1.0:
            theta = self.temperature(rig, own, change.heat)
        unit = HEAT_CAPACITY_CP * ambient
        stored = (own.pressure_pa + gas["atmospheric_pressure_pa"]) * volume_m3(muscle, own.contraction)
        stored = stored * HEAT_CAPACITY_CV / GAS_CONSTANT / unit + change.stored
        work = absolute * slope * own.speed - transfer * (ambient - theta)
        inflow = np.where(total > 0, total, total * theta / ambient)
        return -(self.first @ stored) + self.once @ (work / unit - inflow)

    def air(self, rig, own, heat):
        """Absolute pressure [Pa], volume [m³], its slope in contraction, and the heat transfer [W/K]."""
        muscle, gas, e = rig["muscle"], rig["gas"], own.smooth_contraction
        volume = volume_m3(muscle, e)
        area = 2 * np.sqrt(np.pi * volume * muscle["initial_length_m"] * (1 - e))
        filling = own.reference_pa > own.smooth_pressure_pa
        transfer = np.where(
            filling, gas["heat_transfer_charging_w_per_m2_k"], gas["heat_transfer_discharging_w_per_m2_k"]
        )
        slope = 2 * muscle["volume_d1_m3"] * e + muscle["volume_d2_m3"]
        return own.smooth_pressure_pa + gas["atmospheric_pressure_pa"], volume, slope, heat * area * transfer

    def temperature(self, rig, own, heat):
        """Temperature of the air [K]."""
        absolute, volume, slope, transfer = self.air(rig, own, heat)
        ambient = rig["gas"]["ambient_temperature_k"]
        return temperature(absolute, own.pressure_rate, volume, slope * own.speed, transfer, ambient)

    def load(self, rig, own, force, friction):
        """Residual of the motion's balance [N]."""
        load, length = rig["load"], rig["muscle"]["initial_length_m"]
        inertia = load["mass_kg"] * length
        damping = length * load["viscous_damping_ns_per_m"]
        rubbing = (load["coulomb_friction_n"] + friction) * np.sign(own.speed)
        still = load["mass_kg"] * GRAVITY + rubbing - force
        return inertia * (self.second @ own.contraction) - damping * (self.first @ own.contraction) + self.once @ still

    def deviations(self):
        """Standard deviation of each row from the sensors' noise."""
        own, rig = self.signals, self.rig
        muscle, gas = rig["muscle"], rig["gas"]
        density = max(own.period_s, GRID_S) / GRID_S
        absolute, volume, slope, _ = self.air(rig, own, 1.0)
        unit = GAS_CONSTANT * HEAT_CAPACITY_CP / HEAT_CAPACITY_CV * gas["ambient_temperature_k"]
        per_pressure, per_contraction = self.slopes()
        gain, length = rig["valve"]["flow_gain_kg_per_pa_s"], muscle["initial_length_m"]
        noise = self.noise

        def deviation(*terms):
            """Of sums of operators times a factor by sample, a list for each signal with its noise."""
            variance = 0.0
            for sigma, *operators in terms:
                matrix = sum(operator.multiply(factor[None, :]) for operator, factor in operators)
                variance = variance + sigma**2 * density * np.asarray(matrix.power(2).sum(axis=1)).ravel()
            return np.sqrt(variance)

        one = np.ones_like(volume)
        p, c = noise["pressure_pa"], noise["contraction"]
        parts = [
            deviation(
                (p, (self.first, volume / unit), (self.once, -gain * one)), (c, (self.first, absolute * slope / unit))
            )
        ]
        motion = (self.second, rig["load"]["mass_kg"] * length * one)
        drag = (self.first, -length * rig["load"]["viscous_damping_ns_per_m"] * one)
        if own.force_n is not None:
            f = noise["force_n"]
            parts.append(
                deviation((f, (self.once, one)), (p, (self.once, per_pressure)), (c, (self.once, per_contraction)))
            )
            parts.append(deviation((f, (self.once, one)), (c, motion, drag)))
        else:
            parts.append(deviation((p, (self.once, per_pressure)), (c, motion, drag, (self.once, per_contraction))))
        return np.concatenate(parts)

    def names(self):
        """The balance of each row, 0 gas, 1 force, 2 load, and the time of its centre."""
        count = len(self.centres)
        which = [0, 2] if self.signals.force_n is None else [0, 1, 2]
        return np.repeat(which, count), np.tile(self.centres, len(which))


def volume_m3(muscle, contraction):
    """Eq 2."""
    d1, d2, d3 = (muscle[f"volume_d{i}_m3"] for i in (1, 2, 3))
    return d1 * contraction**2 + d2 * contraction + d3


def bumps(size, half_s):
    """Operators ∫φ·, ∫φ'· and ∫φ''· for bumps of integral 1, centred half a half-width apart."""
    half = min(round(half_s / GRID_S), (size - 1) // 2)
    s = np.arange(-half, half + 1) / half
    inside = np.maximum(1 - s**2, 0)
    bump = inside**4
    scale = 1 / bump.sum()
    width = half * GRID_S
    first = -8 * s * inside**3 / width
    second = (-8 * inside**3 + 48 * s**2 * inside**2) / width**2
    starts = np.arange(0, size - 2 * half, max(1, half // 2))
    columns = (starts[:, None] + np.arange(2 * half + 1)[None, :]).ravel()
    lines = np.repeat(np.arange(len(starts)), 2 * half + 1)

    def operator(kernel):
        values = np.tile(scale * kernel, len(starts))
        return csr_matrix((values, (lines, columns)), shape=(len(starts), size))

    return operator(bump), operator(first), operator(second)


def temperature(absolute, pressure_rate, volume, volume_rate, transfer, ambient):
    """Temperature of the air [K] that the measured pressure and volume imply (Eqs 3 and 4)."""
    growth = pressure_rate / absolute + volume_rate / volume
    power = HEAT_CAPACITY_CV / GAS_CONSTANT * (pressure_rate * volume + absolute * volume_rate) + absolute * volume_rate
    theta = np.empty_like(absolute)
    now = ambient
    mass_per_theta = absolute * volume / GAS_CONSTANT
    for i, (g, e, m, h) in enumerate(zip(growth.tolist(), power.tolist(), mass_per_theta.tolist(), transfer.tolist())):
        theta[i] = now
        heat = h * (ambient - now)
        inlet = ambient if e > heat else now
        # Semi-implicit in the heat, which is stiff with a large factor.
        share = now * now / (HEAT_CAPACITY_CP * inlet * m)
        rate = now * g - share * e
        now = (now + GRID_S * (rate + share * h * ambient)) / (1 + GRID_S * share * h)
        now = min(max(now, 0.5 * ambient), 2.0 * ambient)
    return theta
