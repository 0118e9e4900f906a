"""The library of the sparse regression: terms of the balances, each of which stands for a name.

A term is an effect with its nonlinear parameters at a point of a grid. Its columns are the changes of the
balances' rows by a unit of each of its linear coefficients. The equations are those of docs/effects.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import balances
import numpy as np
from balances import GRID_S, Change
from scipy.signal import lfilter

# Unit of forces and pressures in the catalogue's equations.
PRESSURE_UNIT_PA = 300e3
# A term that is a whole law, not a multiple of one, has a coefficient of about 1.
WHOLE = (0.3, 3.0)
POSITIVE = (0.0, np.inf)
ANY = (-np.inf, np.inf)


@dataclass
class Term:
    """An effect at a point of the grid: what it changes, and how its parameters follow from coefficients."""

    name: str
    form: str | None
    changes: list[Callable[[balances.Balances], Change]]
    bounds: list[tuple[float, float]]
    values: Callable[[np.ndarray], dict | None]

    def columns(self, records, base):
        """A column for each coefficient, over the rows of all records."""
        return np.column_stack(
            [base - np.concatenate([own.rows(change(own)) for own in records]) for change in self.changes]
        )


def lagged(values, time_constant_s, start=None):
    """First-order lag, from a steady state."""
    share = np.exp(-GRID_S / time_constant_s)
    start = values[0] if start is None else start
    return lfilter([1 - share], [1, -share], values, zi=[share * start])[0]


def delayed(values, delay_s):
    """Pure delay."""
    time = np.arange(len(values)) * GRID_S
    return np.interp(time - delay_s, time, values)


def stop(values, threshold):
    """Stop element: what of the motion since the last slip is kept, from -1 to 1."""
    out, slider = np.empty_like(values), values[0]
    for i, value in enumerate(values.tolist()):
        slider = min(max(slider, value - threshold), value + threshold)
        out[i] = (value - slider) / threshold
    return out


def maxwell_slip(contraction, reach, spread=8.0, taper=0.5):
    """The sum z of the catalogue's form of that name."""
    thresholds = reach * spread ** np.linspace(-0.5, 0.5, 6)
    weights = thresholds**-taper
    return sum(w * stop(contraction, d) for w, d in zip(weights / weights.sum(), thresholds))


def choked(upstream, downstream, critical=0.3):
    """Sonic flow per conductance (ISO 6358-1)."""
    ratio = np.maximum(np.clip(downstream / upstream, 0, 1), critical)
    return upstream * np.sqrt(np.maximum(1 - ((ratio - critical) / (1 - critical)) ** 2, 0))


def loss(function):
    return lambda own: Change(loss_n=function(own))


def per_slope(own):
    """f_p(ε)/f_p(0)."""
    muscle = own.rig["muscle"]
    return own.slopes()[0] / (muscle["alpha_m2"] + muscle["beta_m2"])


def muscle_terms():
    """Terms of the muscle's force."""
    terms = []
    for reach in (0.004, 0.01, 0.02, 0.04, 0.1):

        def z(own, reach=reach):
            return maxwell_slip(own.signals.smooth_contraction, reach)

        changes = [loss(z), loss(lambda own, z=z: z(own) * own.signals.smooth_pressure_pa / PRESSURE_UNIT_PA)]

        def values(c, reach=reach):
            force = c[0] + c[1]
            return {"force_n": force, "reach": reach, "spread": 8.0, "taper": 0.5, "base_share": c[0] / force}

        terms.append(Term("hysteresis", None, changes, [POSITIVE, POSITIVE], values))
    for tau in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0):

        def relaxing(own, tau=tau):
            p = own.signals.smooth_pressure_pa / PRESSURE_UNIT_PA
            return per_slope(own) * (p - lagged(p, tau))

        def straining(own, tau=tau):
            e = own.signals.smooth_contraction / 0.25
            return e - lagged(e, tau)

        for form, function in ((None, relaxing), ("strain-relaxation", straining)):
            terms.append(
                Term(
                    "creep",
                    form,
                    [loss(function)],
                    [POSITIVE],
                    lambda c, tau=tau: {"force_n": c[0], "time_constant_s": tau},
                )
            )
    for edge in (3e3, 6e3, 12e3, 25e3, 50e3, 100e3):
        terms.append(
            Term(
                "dead-band",
                None,
                [loss(lambda own, edge=edge: own.slopes()[0] * np.minimum(own.signals.smooth_pressure_pa, edge))],
                [WHOLE],
                lambda c, edge=edge: {"pressure_pa": edge * c[0]},
            )
        )
    for growth in (3.0, 10.0, 20.0):

        def stiffening(own, growth=growth):
            return np.expm1(growth * own.signals.smooth_contraction) / np.expm1(growth * 0.25)

        terms.append(
            Term(
                "bladder-elasticity",
                None,
                [loss(stiffening)],
                [ANY],
                lambda c, growth=growth: {"force_n": c[0], "growth": growth},
            )
        )
    powers = [loss(lambda own, n=n: (own.signals.smooth_contraction / 0.25) ** n) for n in (1, 2)]
    terms.append(
        Term(
            "bladder-elasticity",
            "polynomial",
            powers,
            [ANY, ANY],
            lambda c: {"linear_n": c[0], "quadratic_n": c[1]},
        )
    )

    def pushing(own):
        return np.minimum(own.force(own.rig, own.signals), 0)

    terms.append(Term("slack", None, [loss(pushing)], [(0.8, 1.2)], lambda c: {}))
    terms.append(Term("slack", "folded", [loss(pushing)], [(0.1, 0.8)], lambda c: {"push_share": 1 - c[0]}))
    for distance in (0.05, 0.2, 0.5, 1.0, 3.0):
        for form, law in (("exponential", lambda s: np.exp(-s)), ("hyperbolic", lambda s: 1 / (1 + s))):

            def running_in(own, law=law, distance=distance):
                e = own.signals.smooth_contraction
                moved = np.cumsum(np.abs(np.diff(e - 0.001 * stop(e, 0.001), prepend=e[0])))
                return -own.force(own.rig, own.signals) * law(moved / distance)

            terms.append(
                Term(
                    "run-in",
                    form,
                    [loss(running_in)],
                    [ANY],
                    lambda c, distance=distance: {"share": c[0], "distance": distance},
                )
            )
    return terms


def load_terms():
    """Terms of the load's motion and of its encoder."""

    def rubbing(function):
        return lambda own: Change(friction_n=function(own.signals))

    terms = [Term("friction", None, [lambda own: Change(friction_n=1.0)], [POSITIVE], lambda c: {"force_n": c[0]})]
    for speed in (0.003, 0.01, 0.03):

        def stribeck(own, speed=speed):
            velocity = own.speed
            return 1 + 0.5 * np.exp(-((velocity * 0.4 / speed) ** 2))

        terms.append(
            Term(
                "friction",
                "stribeck",
                [rubbing(stribeck)],
                [POSITIVE],
                lambda c, speed=speed: {"force_n": c[0], "static_ratio": 1.5, "speed_m_per_s": speed},
            )
        )

    def heavier(own):
        load = own.rig["load"]
        return Change(rig={**own.rig, "load": {**load, "mass_kg": load["mass_kg"] + 0.1}})

    terms.append(Term("payload", None, [heavier], [ANY], lambda c: {"mass_kg": 0.1 * c[0]}))
    for play in (5e-4, 1e-3, 2e-3, 4e-3):

        def played(own, play=play):
            signals, half = own.signals, play / (2 * own.rig["muscle"]["initial_length_m"])
            # The side of the play on which the encoder is: it changes with the direction of motion.
            side = half * stop(signals.smooth_contraction, 5e-4)
            return Change(
                signals=replace(
                    signals,
                    contraction=signals.contraction + side,
                    smooth_contraction=signals.smooth_contraction + side,
                )
            )

        terms.append(Term("backlash", None, [played], [WHOLE], lambda c, play=play: {"play_m": play * c[0]}))
    return terms


def valve_terms(scale):
    """Terms of valve, line and supply; `scale` is the largest error of filling and of exhausting [Pa]."""

    def error(function):
        return lambda own: Change(error_pa=function(own))

    def clipped(own):
        return np.clip(own.signals.reference_pa, 0, own.rig["valve"]["supply_pressure_pa"])

    terms = []
    for width in (1e3, 2e3, 4e3, 8e3, 16e3, 32e3):

        def closed(own, width=width, sides=(1, 1)):
            e = own.error_pa()
            raw = clipped(own) - own.signals.pressure_pa
            lost = np.clip(e, -width * sides[1], width * sides[0])
            return raw - lost

        sides = [error(lambda own, c=closed, s=s: c(own, sides=s)) for s in ((1, 0), (0, 1))]
        terms.append(
            Term(
                "valve-dead-zone",
                None,
                [error(closed)],
                [WHOLE],
                lambda c, width=width: {"half_width_pa": width * c[0]},
            )
        )
        terms.append(
            Term(
                "valve-dead-zone",
                "asymmetric",
                sides,
                [(0, 3.0), (0, 3.0)],
                lambda c, width=width: {"filling_pa": width * c[0], "exhausting_pa": width * c[1]},
            )
        )
    for tau in (0.005, 0.01, 0.02, 0.04, 0.08, 0.16):

        def lag(own, tau=tau):
            return lagged(clipped(own), tau) - own.signals.pressure_pa

        def spool(own, tau=tau):
            return lagged(lagged(clipped(own), tau), tau) - own.signals.pressure_pa

        def late(own, tau=tau):
            return delayed(clipped(own), tau) - own.signals.pressure_pa

        def dispersed(own, tau=tau):
            return lagged(lagged(delayed(clipped(own), 0.7 * tau), 0.15 * tau), 0.15 * tau) - own.signals.pressure_pa

        terms += [
            Term("valve-lag", None, [error(lag)], [WHOLE], lambda c, tau=tau: {"time_constant_s": tau * c[0]}),
            Term(
                "valve-lag",
                "second-order",
                [error(spool)],
                [WHOLE],
                lambda c, tau=tau: {"time_constant_s": tau * c[0], "damping_ratio": 1.0},
            ),
            Term("transport-delay", None, [error(late)], [WHOLE], lambda c, tau=tau: {"delay_s": tau * c[0]}),
            Term(
                "transport-delay",
                "dispersed",
                [error(dispersed)],
                [WHOLE],
                lambda c, tau=tau: {"delay_s": tau * c[0], "dispersion": 0.21},
            ),
        ]
    return terms + flow_terms(scale) + supply_terms() + line_terms()


def flow_terms(scale):
    """Limits of the valve's flow, as shares of the largest flow that Eq 9 asks for."""

    def limited(fill, exhaust):
        def change(own):
            valve, atmosphere = own.rig["valve"], own.rig["gas"]["atmospheric_pressure_pa"]
            gain = valve["flow_gain_kg_per_pa_s"]
            supply = valve["supply_pressure_pa"] + atmosphere
            absolute = own.signals.smooth_pressure_pa + atmosphere
            flow = gain * own.error_pa()
            high = fill * gain * scale[0] / supply * choked(supply, absolute) if fill else np.inf
            low = exhaust * gain * scale[1] / supply * choked(absolute, atmosphere) if exhaust else np.inf
            raw = gain * (own.error_pa() + own.signals.smooth_pressure_pa - own.signals.pressure_pa)
            return Change(flow=raw + np.clip(flow, -low, high) - flow)

        return change

    terms = []
    shares = (0.8, 0.55, 0.4, 0.25, 0.15, 0.08)
    for fill in (*shares, None):
        for exhaust in (*shares, None):
            sides = [limited(fill, None)] * bool(fill) + [limited(None, exhaust)] * bool(exhaust)
            if sides:
                values = ConductanceValues(fill, exhaust, scale)
                terms.append(Term("flow-limit", None, sides, [(0.3, 1.7)] * len(sides), values))
    return terms


@dataclass
class ConductanceValues:
    """Parameters of the flow limit; needs the rig's gain and supply, which `gain` gives per pascal of them."""

    fill: float | None
    exhaust: float | None
    scale: tuple[float, float]
    gain: float = 1.0

    def __call__(self, c):
        open_wide = 1e-3
        return {
            "filling_conductance_kg_per_pa_s": self.fill * self.scale[0] * self.gain if self.fill else open_wide,
            "exhausting_conductance_kg_per_pa_s": self.exhaust * self.scale[1] * self.gain
            if self.exhaust
            else open_wide,
            "critical_ratio": 0.3,
        }


def supply_terms():
    """A supply whose pressure droops with the air that is taken from it."""
    terms = []
    for volume in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 5e-2):
        for recovery in (0.3, 1.0, 3.0, 10.0, 30.0):

            def drooping(own, volume=volume, recovery=recovery):
                valve, gas = own.rig["valve"], own.rig["gas"]
                flow = valve["flow_gain_kg_per_pa_s"] * np.maximum(own.error_pa(), 0)
                pressure_rate = balances.GAS_CONSTANT * gas["ambient_temperature_k"] / volume * flow
                droop = lagged(pressure_rate * recovery, recovery, start=0.0)
                supply = np.maximum(valve["supply_pressure_pa"] - droop, 0)
                return Change(error_pa=np.clip(own.signals.reference_pa, 0, supply) - own.signals.pressure_pa)

            terms.append(
                Term(
                    "supply-droop",
                    None,
                    [drooping],
                    [WHOLE],
                    lambda c, v=volume, t=recovery: {"reservoir_volume_m3": v / c[0], "recovery_time_s": t},
                )
            )
    return terms


def line_terms():
    """A hose between valve and muscle, and a tube to the sensor."""

    def hose(own):
        unit = balances.HEAT_CAPACITY_CV / balances.HEAT_CAPACITY_CP / balances.GAS_CONSTANT
        unit /= own.rig["gas"]["ambient_temperature_k"]
        return Change(stored=1e-5 * unit * own.signals.pressure_pa)

    def later(own):
        signals = own.signals
        step = -0.005 * signals.pressure_rate
        # The valve sees the port, which is what is read.
        moved = signals.with_pressure(signals.pressure_pa + step, signals.smooth_pressure_pa + step)
        gain = own.rig["valve"]["flow_gain_kg_per_pa_s"]
        supply = own.rig["valve"]["supply_pressure_pa"]
        flow = gain * (np.clip(signals.reference_pa, 0, supply) - signals.pressure_pa)
        return Change(signals=moved, flow=flow)

    def true_pressure(order, unit):
        def change(own):
            signals = own.signals
            rate = signals.pressure_rate
            if order == 2:
                rate = balances.Smoother(signals.period_s)(rate, 1)
            step = unit * rate
            return Change(signals=signals.with_pressure(signals.pressure_pa + step, signals.smooth_pressure_pa + step))

        return change

    def tube(c):
        omega = 1 / np.sqrt(2.5e-5 * c[1])
        return {"period_s": 2 * np.pi / omega, "damping_ratio": 0.005 * c[0] * omega / 2}

    return [
        Term(
            "line-dynamics",
            None,
            [later, hose],
            [POSITIVE, POSITIVE],
            lambda c: {"lag_s": 0.005 * c[0], "hose_volume_m3": max(1e-5 * c[1], 1e-6)},
        ),
        Term(
            "line-dynamics",
            "sensor-tube",
            [true_pressure(1, 0.005), true_pressure(2, 2.5e-5)],
            [POSITIVE, (1e-2, np.inf)],
            tube,
        ),
    ]


def gas_terms():
    """Leaks, and the heat through the muscle's wall."""

    def orifice(own):
        atmosphere = own.rig["gas"]["atmospheric_pressure_pa"]
        return choked(np.maximum(own.signals.smooth_pressure_pa, 0) + atmosphere, atmosphere, 0.5)

    def power(own, exponent):
        return PRESSURE_UNIT_PA * (np.maximum(own.signals.smooth_pressure_pa, 0) / PRESSURE_UNIT_PA) ** exponent

    def leaking(function):
        return lambda own: Change(leak=1e-9 * function(own))

    def conductance(c, **others):
        return {"conductance_kg_per_pa_s": 1e-9 * c[0], **others}

    terms = [
        Term("leak", None, [leaking(lambda own: power(own, 1.0))], [POSITIVE], conductance),
        Term("leak", "orifice", [leaking(orifice)], [POSITIVE], conductance),
    ]
    for exponent in (0.5, 1.5, 2.0, 3.0):
        terms.append(
            Term(
                "leak",
                "power",
                [leaking(lambda own, n=exponent: power(own, n))],
                [POSITIVE],
                lambda c, n=exponent: conductance(c, power=n),
            )
        )
    for factor in (0.1, 0.4, 2.0, 4.0, 10.0, 40.0):
        terms.append(
            Term(
                "heat-exchange",
                None,
                [lambda own, f=factor: Change(heat=f)],
                [WHOLE],
                lambda c, f=factor: {"factor": max(1 + (f - 1) * c[0], 0.02)},
            )
        )
    return terms


def sensor_terms(force_channel):
    """Errors of the sensors."""

    def pressure(function):
        def change(own):
            signals = own.signals
            step = function(signals)
            return Change(signals=signals.with_pressure(signals.pressure_pa - step, signals.smooth_pressure_pa - step))

        return change

    def shifted(own):
        signals = own.signals
        return Change(
            signals=replace(
                signals, contraction=signals.contraction - 0.005, smooth_contraction=signals.smooth_contraction - 0.005
            )
        )

    gain = [
        pressure(lambda s, n=n: 0.01 * s.smooth_pressure_pa * (s.smooth_pressure_pa / PRESSURE_UNIT_PA) ** n)
        for n in (0, 1)
    ]
    terms = [
        Term("pressure-sensor-offset", None, [pressure(lambda s: 1e3)], [ANY], lambda c: {"offset_pa": 1e3 * c[0]}),
        Term("pressure-sensor-gain", None, gain[:1], [ANY], lambda c: {"gain_error": 0.01 * c[0]}),
        Term(
            "pressure-sensor-gain",
            "quadratic",
            gain,
            [ANY, ANY],
            lambda c: {"gain_error": 0.01 * c[0], "nonlinearity": 0.01 * c[1]},
        ),
        Term(
            "pressure-sensor-drift",
            None,
            [pressure(lambda s: 10 * s.time_s)],
            [ANY],
            lambda c: {"drift_pa_per_s": 10 * c[0]},
        ),
        Term("contraction-sensor-offset", None, [shifted], [ANY], lambda c: {"offset": 0.005 * c[0]}),
    ]
    for tau in (5.0, 20.0, 60.0):
        terms.append(
            Term(
                "pressure-sensor-drift",
                "warm-up",
                [pressure(lambda s, tau=tau: 1e3 * -np.expm1(-s.time_s / tau))],
                [ANY],
                lambda c, tau=tau: {"drift_pa": 1e3 * c[0], "time_constant_s": tau},
            )
        )
    if force_channel:

        def untared(own):
            return Change(signals=replace(own.signals, force_n=own.signals.force_n - 1.0))

        terms.append(Term("force-sensor-offset", None, [untared], [ANY], lambda c: {"offset_n": c[0]}))
    return terms


def library(records):
    """All terms for the balances of some records."""
    errors = np.concatenate([own.error_pa() for own in records])
    scale = (max(errors.max(), 1.0), max(-errors.min(), 1.0))
    force_channel = records[0].signals.force_n is not None
    terms = muscle_terms() + load_terms() + valve_terms(scale) + gas_terms() + sensor_terms(force_channel)
    rig = records[0].rig
    supply = rig["valve"]["supply_pressure_pa"] + rig["gas"]["atmospheric_pressure_pa"]
    for term in terms:
        if isinstance(term.values, ConductanceValues):
            term.values.gain = rig["valve"]["flow_gain_kg_per_pa_s"] / supply
    return terms
