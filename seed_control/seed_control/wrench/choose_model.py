# SPDX-License-Identifier: Apache-2.0
"""Which model the wrench comes from, and how an identification becomes one; refused where it is of something else."""

from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from seed_control.monitor.pressure_check import PressureCheck
from seed_core.bushing import Bushing, Stiffness
from seed_core.config import ConfigError
from seed_core.hand import Hand
from seed_core.hysteretic.file import load_hysteretic
from seed_core.hysteretic.spring import HystereticSpring
from seed_core.membrane.map import MembraneMap
from seed_core.stiffness_file import StiffnessFile, load_stiffness
from seed_core.wrench_model import BushingModel, WrenchModel
from seed_core.wrench_settings import WrenchSettings


class ChosenModel(NamedTuple):
    """A model of the wrench, and the check of the pressures that goes with its identification."""

    model: WrenchModel
    pressure: PressureCheck


def choose_model(
    settings: WrenchSettings, stiffness: Stiffness, hand: Hand, today: datetime | None = None, grips: str = ""
) -> ChosenModel:
    """The model that the settings ask for.

    Args:
        stiffness: of the bushing. hand: in use.
        today: with its time zone, for the age of an identification; None: it is new.
        grips: stiffness.yaml that the stiffness follows; tells how well a bushing is known if no other file does.

    Raises:
        ConfigError: no file where one is needed, one that cannot be read, or of another hand; or no such model.
    """
    if settings.model == "membrane":
        if not settings.file:
            raise ConfigError("wrench.model = 'membrane' needs wrench.file, the membrane_map.yaml of this hand")
        model = MembraneMap.load(settings.file)
        same_hand(settings.file, model.file.hand, hand)
        pressures = [grip.pressure_hpa for grip in model.file.grips]
        return ChosenModel(model, PressureCheck(pressures, needed=model.file.needs_pressure))
    if settings.model == "hysteretic":
        if not settings.file:
            raise ConfigError("wrench.model = 'hysteretic' needs wrench.file, the hysteretic_spring.yaml of this hand")
        spring = load_hysteretic(settings.file)
        same_hand(settings.file, spring.hand, hand)
        return ChosenModel(HystereticSpring(spring.identified), PressureCheck([spring.pressure_hpa]))
    if settings.model != "bushing":
        raise ConfigError(f"wrench.model = '{settings.model}': seed_control.wrench.choose_model cannot make it")
    bushing = BushingModel(Bushing(stiffness), settings)
    if not (name := settings.file or grips):
        return ChosenModel(bushing, PressureCheck())
    file = load_stiffness(name)
    same_hand(name, file.hand, hand)
    unexplained = np.array(file.torque_unexplained + file.force_unexplained)
    bushing.identified(relative_deviations(file), age(file.date, today) if today is not None else 0.0, unexplained)
    pressures = [grip.pressure_hpa for grip in file.grips] if settings.file else []
    return ChosenModel(bushing, PressureCheck(pressures))


def relative_deviations(file: StiffnessFile) -> np.ndarray | None:
    """(6,) largest of the grips, of [rotation, translation]; None where a grip states none."""
    rows = [np.array(g.rotation_std + g.translation_std) / g.stiffness.vector() for g in file.grips]
    worst = np.max(rows, axis=0)
    return worst if all((row > 0.0).all() for row in rows) else None


def age(date: str, today: datetime) -> float:
    """Days since an ISO 8601 date. Raises ConfigError when it is none."""
    try:
        then = datetime.fromisoformat(date)
    except ValueError as error:
        raise ConfigError(f"date = '{date}' of the identification is no ISO 8601 date: {error}") from error
    then = then if then.tzinfo else then.replace(tzinfo=UTC)
    return max((today - then).total_seconds() / 86400.0, 0.0)


def same_hand(file: str, identified: str, hand: Hand) -> None:
    """Raises ConfigError when an identification is of another hand."""
    if identified != hand.name:
        raise ConfigError(
            f"{file} was identified with the hand '{identified}'; hand.name is '{hand.name}': identify this one, or "
            "name it alike if it is the same"
        )
