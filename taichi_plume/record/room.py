"""Recording of a room before any run: its static scene, and the robots at their starts."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from taichi_plume.grid.shapes import Shape
from taichi_plume.record import drawing, scene
from taichi_plume.record.layout import BACKGROUND
from taichi_plume.record.placement import Stage
from taichi_plume.scenario.palette import rgb, robot_color
from taichi_plume.scenario.scenario import Scenario

ELEVATION, AZIMUTH = 40.0, 25.0  # degrees, of the camera


def room(scenario: Scenario, shapes: Sequence[Shape]) -> bytes:
    """Return the recording (.rrd) of a checked scenario's room in one view; shapes: of the obstacles."""
    stage = Stage.of(scenario.domain.extent)
    corners = np.array(
        [[x, y, z] for x in (0, stage.extent[0]) for y in (0, stage.extent[1]) for z in (0, stage.height)]
    )
    position, target, up = drawing.camera(corners, 1.0, ELEVATION, AZIMUTH)
    view = rrb.Spatial3DView(
        origin="/", name=scenario.name, background=BACKGROUND, line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=up),
    )  # fmt: skip
    panels = [
        kind(state="collapsed")
        for kind in (rrb.TopPanel, rrb.BlueprintPanel, rrb.SelectionPanel, rrb.TimePanel)
    ]
    stream = rr.RecordingStream("taichi_plume")
    stream.send_recording_name(scenario.name)
    recorded = stream.binary_stream()
    stream.send_blueprint(rrb.Blueprint(view, *panels, auto_views=False))
    for entity, archetype in (*scene.arena(scenario, shapes, stage), *_starts(scenario, stage)):
        stream.log(entity, archetype, static=True)
    return recorded.read(flush=True) or b""


def _starts(scenario: Scenario, stage: Stage) -> scene.Entities:
    """Yield the robots' bodies at their starts; those of random starts in the middle of their area, once."""
    first = 0
    for n, group in enumerate(scenario.robots):
        places, start = group.places(scenario.floor), vars(group.start)
        if places is None:
            places = np.array([start.get("low", (0, 0)), start.get("high", stage.extent[:2])], float).mean(
                axis=0
            )[None]
        body = group.body
        for k, place in enumerate(places):
            color = rgb(robot_color(first + k))
            entity = f"starts/{n}/{k}"
            turn = np.radians(group.start.heading_deg or 0.0)
            yield (
                entity,
                rr.Transform3D(
                    translation=[*place[:2], group.start_altitude],
                    rotation=rr.RotationAxisAngle([0, 0, 1], radians=turn),
                ),
            )
            yield f"{entity}/body", scene.body(body.radius, body.height, color, stage)
        first += group.count
