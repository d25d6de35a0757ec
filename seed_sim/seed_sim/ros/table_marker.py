# SPDX-License-Identifier: Apache-2.0
"""The shape of the simulated table as a message that RViz, Foxglove and the page draw."""

from geometry_msgs.msg import Point, PoseStamped
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from seed_core.meshes import PAPER
from seed_core.spatial import Array
from seed_ros.conversions import fill
from seed_sim.plant.table import Surface
from seed_sim.replay.fixtures import table_mesh

_CELL = 0.01  # [m] of its mesh: 0.4 MB once, for whoever comes


def table_marker(surface: Surface, X_WS: PoseStamped) -> Marker:
    """Triangles of the table where it stands, as it is at rest."""
    mesh = table_mesh(surface, cell=_CELL)
    marker = Marker(header=X_WS.header, ns="table", type=Marker.TRIANGLE_LIST, pose=X_WS.pose, frame_locked=True)
    fill(marker.scale, (1.0, 1.0, 1.0))
    red, green, blue = (c / 255.0 for c in PAPER)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
    marker.points = _points(mesh.vertices[mesh.faces].reshape(-1, 3))
    return marker


def _points(corners: Array) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in corners.astype(float).tolist()]
