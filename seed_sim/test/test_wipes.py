# SPDX-License-Identifier: Apache-2.0
"""The score over a whole wipe: the short form of `./seed bench law`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seed_sim.scenario import load_scenario
from seed_sim.wipes.bandwidth import bandwidth, gain
from seed_sim.wipes.campaign import campaign, summary, table
from seed_sim.wipes.conditions import CONDITIONS
from seed_sim.wipes.poses import CorrelatedPoses
from seed_sim.wipes.run import wipe

SHORT = ((0.05, 0.05, 0.2),)  # leg of a wipe of a second


def test_the_first_millimetre_counts() -> None:
    """A blade that has not been dragged leans as it starts to slide, and the force errs by more; the path waits."""
    with_drag, without = (wipe(replace(CONDITIONS[name], legs=SHORT), 700) for name in ("drag", "no drag"))
    assert without.lean > with_drag.lean + 1.0
    assert without.lean < 5.5  # 8 degrees where it does not wait
    assert without.force > with_drag.force


def test_every_condition_makes_a_task_and_a_cell() -> None:
    for condition in CONDITIONS.values():
        task = condition.task()
        assert next(p.name for p in task.phases if p.name.startswith("wipe")) == "wipe"
        assert task.phases[-1].name == "lift"
        scenario, stiffness = condition.scenario(), condition.stiffness or (4.0, condition.pitch or 3.0, 4.0)
        assert scenario.grasp.stiffness.rotation == tuple(stiffness[:3])
        assert scenario.table.friction == (condition.friction or 0.4)


@pytest.mark.parametrize("time", [0.0, 0.3, 3.0])
def test_noise_is_of_the_stated_size_and_correlated_over_the_stated_time(time: float) -> None:
    source = CorrelatedPoses(load_scenario("nominal"), 5, time, 1.0)
    plant = _Still()
    for i in range(20000):
        plant.time = i * source.period
        source.measure(plant, plant.time)  # type: ignore[arg-type]
    noise = np.array([e for _, e in source.noise]) / 3e-4
    assert noise.std() == pytest.approx(1.0, rel=0.1)
    lag = round(max(time, 0.1) / source.period)
    assert np.mean(noise[:-lag] * noise[lag:]) == pytest.approx(np.exp(-1.0) if time else 0.0, abs=0.12)


class _Still:
    time = 0.0
    X_CT = np.eye(4)


def test_a_campaign_goes_on_from_what_it_kept_and_makes_a_table(tmp_path: Path) -> None:
    kept = tmp_path / "wipes.jsonl"
    first = campaign(["drag"], [700], keep=kept)
    line = json.loads(kept.read_text())
    kept.write_text(json.dumps(line | {"force": 9.0, "ended": "held"}) + '\n{"law": "seed", "cond')
    again = campaign(["drag"], [700], keep=kept)
    assert again == [first[0]._replace(force=9.0, ended="held")]
    text = table(summary(again))
    assert "drag" in text
    assert "9.00" in text
    assert "drag, seed 700: held" in text


def test_a_slow_force_is_followed() -> None:
    assert abs(gain(1.0, 700)) == pytest.approx(1.0, abs=0.15)


def test_bandwidth_is_where_the_gain_falls_below_half_the_power() -> None:
    assert bandwidth([(1.0, 1.0 + 0j), (2.0, 0.9j), (3.0, 0.5 + 0j)]) == pytest.approx(2.0 + (0.9 - 0.5**0.5) / 0.4)
