# SPDX-License-Identifier: Apache-2.0
"""A run to look at afterwards: what is kept of it, and the page of one file that plays it without a network."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seed_sim.replay.film import Film, Moment

if TYPE_CHECKING:
    from seed_sim.plant.plant import Plant

__all__ = ["Film", "Moment", "replay_of"]


def replay_of(plant: Plant, film: Film, model: str = "ur5e") -> str:
    """The page of a film of this plant; raises SeedError where nothing was kept, or viser is missing."""
    from seed_sim.replay.fixtures import table_mesh
    from seed_sim.replay.page import replay_page

    scenario, hold = plant.scenario, plant.membranes
    triangles = {} if hold is None else {f: b.triangles for f, b in hold.state.bubbles.items()}
    return replay_page(
        list(film.moments),
        plant.hand,
        plant.tool,
        scenario.tool_kind,
        plant.surface.X_WS if plant.hole is None else plant.hole.X_WH,
        model=model,
        triangles=triangles,
        table=table_mesh(plant.surface),
        blade_width=scenario.blade_width,
    )
