"""The installed package beside the command line, whose program is in HIL_SIM."""

import _thread
import json
import os
import re
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import hil_sim

PROGRAM = os.environ["HIL_SIM"]
LEAK = '\n[[effect]]\nname = "leak"\nconductance_kg_per_pa_s = 4e-9\n'
OWN_EFFECT = """
[own_effect.stiffer]
subsystem = "muscle-force"
parameter.size_n = { unit = "N", min = -50, max = 50, typical = 5, neutral = 0 }
adds.force_n = "size_n * contraction"
"""


def command(folder, *arguments):
    """What `hil-sim` prints in `folder`, and its errors."""
    done = subprocess.run([PROGRAM, "-q", *arguments], cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout, done.stderr


@pytest.fixture(scope="module")
def rig():
    return hil_sim.Rig.template()


@pytest.fixture(scope="module")
def leaking(rig):
    return hil_sim.Rig(rig.text + LEAK)


def measured(rig, seed):
    """A record of a leaking rig: steps of the reference, with the noise of sensors."""
    random = np.random.default_rng(seed)
    time_s = np.arange(0, 20, 0.01)
    reference_pa = np.repeat(random.uniform(2e5, 4.5e5, 10), 200)
    drive = {"time_s": time_s, "pressure_ref_pa": reference_pa}
    record = hil_sim.simulate(rig, drive).record
    record["pressure_pa"] += random.normal(0, 250, len(time_s))
    record["contraction"] += random.normal(0, 3e-5, len(time_s))
    return record


@pytest.fixture(scope="module")
def records(leaking):
    return [measured(leaking, seed) for seed in range(2)]


@pytest.fixture(scope="module")
def found(rig, records):
    return hil_sim.diagnose(rig, records[:1], records[1:])


def test_a_leak_is_named_from_data_frames(found):
    assert (found.verdict, [effect.name for effect in found.effects]) == ("explained", ["leak"])
    frame = found.to_frame()
    assert list(frame["parameter"]) == ["conductance_kg_per_pa_s"]
    assert frame["value"][0] == pytest.approx(4e-9, rel=0.1)
    assert found.gap_frame().loc["pressure_pa", "removed"] > 0.9
    assert "leak: probability" in str(found)
    assert "name = \"leak\"" in found.fitted_rig.text
    assert found.report_html.startswith("<!doctype html>")
    measured, nominal, fitted = found.validation[0]
    off_pa = [np.std(run["pressure_pa"] - measured["pressure_pa"]) for run in (nominal, fitted)]
    assert off_pa[1] < 0.5 * off_pa[0]


def without_times(text):
    return re.sub(r'"spent_s": [0-9.e-]+', '"spent_s": 0', text)


def test_json_is_that_of_the_command_line(tmp_path, rig, records, found):
    rig.write(tmp_path / "rig.toml")
    paths = []
    for place, record in enumerate(records):
        paths.append(tmp_path / f"{place}.csv")
        record.to_csv(paths[-1], index=False)
    a, b = paths
    # Pandas writes the shortest decimals: these are the same numbers.
    command(tmp_path, "diagnose", "--rig", "rig.toml", "--fit", a.name, "--validate", b.name, "--out", "d")
    written = (tmp_path / "d/diagnosis.json").read_text()
    assert without_times(found.json) == without_times(written)
    mapping = {name: records[0][name].to_numpy() for name in records[0]}
    for one in (str(a), a, records[0], mapping):
        printed, _ = command(tmp_path, "check", a.name, "--json", "--rig", "rig.toml")
        assert hil_sim.check(one, rig).json == printed
    printed, _ = command(tmp_path, "simulate", "--rig", "rig.toml", "--drive", a.name, "--out", "s.csv", "--json")
    simulated = hil_sim.simulate(rig, records[0])
    assert simulated.json == printed
    pd.testing.assert_frame_equal(simulated.record, pd.read_csv(tmp_path / "s.csv"), rtol=1e-15)
    printed, _ = command(tmp_path, "design", "--rig", "rig.toml", "--json")
    assert hil_sim.design(rig).json == printed
    printed, _ = command(tmp_path, "effects", "--json")
    assert [kind.name for kind in hil_sim.effects()] == [kind["name"] for kind in json.loads(printed)]
    assert hil_sim.effects("leak")[0].forms[0]["toml"].startswith("[[effect]]\nname = \"leak\"")
    own = rig.text + OWN_EFFECT
    (tmp_path / "own.toml").write_text(own)
    printed, _ = command(tmp_path, "effects", "--json", "--rig", "own.toml")
    for one in (tmp_path / "own.toml", hil_sim.Rig(own)):
        assert [kind.name for kind in hil_sim.effects(rig=one)] == [kind["name"] for kind in json.loads(printed)]
        assert hil_sim.effects("stiffer", rig=one)[0].name == "stiffer"
    printed, _ = command(tmp_path, "experiment", "--rig", "rig.toml", "--out", "experiment", "--json")
    written = hil_sim.experiment(rig)
    assert written.json == printed
    expected = pd.read_csv(tmp_path / "experiment").astype(float)
    pd.testing.assert_frame_equal(written.record, expected, rtol=1e-15)


def test_what_is_wrong_is_said_in_the_words_of_the_command_line(tmp_path, rig, records):
    in_bar = records[0].assign(pressure_pa=records[0]["pressure_pa"] / 1e5)
    in_bar["pressure_ref_pa"] /= 1e5
    in_bar.to_csv(tmp_path / "a.csv", index=False)
    rig.write(tmp_path / "rig.toml")
    _, error = command(tmp_path, "simulate", "--rig", "rig.toml", "--drive", "a.csv", "--out", "s.csv")
    with pytest.raises(hil_sim.BadInputError) as raised:
        hil_sim.simulate(rig, in_bar)
    words = error.removeprefix("hil-sim: a.csv: ").strip()
    assert "most likely bar" in words
    assert str(raised.value).replace("import drive ", "import a.csv ") == f"drive: {words}"
    wrong = {
        "a column `time_s`": lambda: hil_sim.check({"force_n": [1.0, 2.0]}),
        "columns of equal length": lambda: hil_sim.check({"time_s": [0.0, 1.0], "force_n": [1.0]}),
        "did you mean leak?": lambda: hil_sim.effects("leek"),
        "did you mean stiffer?": lambda: hil_sim.effects("stifer", rig=hil_sim.Rig(rig.text + OWN_EFFECT)),
        "did you mean conductance": lambda: hil_sim.Rig(rig.text + LEAK.replace("conductance", "conductanse")).check(),
        "at most 1": lambda: hil_sim.Rig(rig.text.replace("alpha_m2 = 0.05 ", "alpha_m2 = 5 ")).check(),
        "expected one of": lambda: hil_sim.experiment(rig, ["hold"]),
        "readable CSV": lambda: hil_sim.check("nowhere.csv"),
        "did you mean `pressure_pa`?": lambda: hil_sim.check(records[0].rename(columns={"pressure_pa": "presure_pa"})),
        "column `pressure_pa`: expected numbers": lambda: hil_sim.check(records[0].assign(pressure_pa="2,5")),
        "a record that is not fitted too": lambda: hil_sim.diagnose(rig, records[:1], records[:1]),
        "at least one record, found none": lambda: hil_sim.diagnose(rig, records, []),
        "a number from 0.000000000001 to 0.01": lambda: hil_sim.simulate(rig, records[0], tolerance=-1.0),
        "without: expected one of": lambda: hil_sim.diagnose(rig, records[:1], records[1:], without=["leek"]),
    }
    for words, call in wrong.items():
        with pytest.raises(hil_sim.BadInputError, match=re.escape(words)):
            call()


def test_progress_is_told_and_an_error_in_it_ends_the_work(rig, records):
    told = []
    hil_sim.diagnose(rig, records[:1], records[1:], progress=lambda *step: told.append(step))
    stages = [stage for stage, _, _ in told]
    assert "effects alone" in stages
    assert any(effects for _, _, effects in told)

    def fails(stage, sets, effects):
        raise RuntimeError(stage)

    with pytest.raises(RuntimeError, match="data and noise"):
        hil_sim.diagnose(rig, records[:1], records[1:], progress=fails)


def test_ctrl_c_ends_a_diagnosis(rig, records):
    threading.Timer(0.3, _thread.interrupt_main).start()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        # It would take minutes.
        hil_sim.diagnose(rig, records[:1] * 8, records[1:], threads=1)
    assert time.monotonic() - begun < 2.0


def test_plots_show_both_simulations(found):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    figure = found.plot()
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert labels == ["measured", "nominal rig", "fitted rig"]
    assert len(figure.axes) == len(found.gaps)


def test_types_are_told():
    assert (Path(hil_sim.__file__).parent / "py.typed").exists()
    assert hil_sim.__version__ == hil_sim._native.__version__
