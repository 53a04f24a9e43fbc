"""An attribute that nobody reads cannot be set."""

from unittest import mock

import numpy as np
import pytest

from taichi_plume import client
from taichi_plume.agents.own_robots import Robots


@pytest.mark.parametrize(
    ("flies", "name", "meant"),
    [
        (False, "sped", "'speed'"),
        (False, "turnrate", "'turn_rate'"),
        (False, "left_speed", "'left_speed'"),
        (True, "climbrate", "'climb_rate'"),
        (False, "position", "can only be read"),
        (False, "t", "can only be read"),
    ],
)
def test_only_commands_of_robots_can_be_set(flies, name, meant):
    robots = Robots(np.zeros(2, int), np.arange(2), np.zeros((2, 0, 0)), np.zeros((2, 0)), flies)
    with robots.sealed():
        with pytest.raises(AttributeError, match=name) as caught:
            setattr(robots, name, 0.1)
        robots.speed, robots.turn_rate, robots.state = 0.1, 0.2, 0
    assert meant in str(caught.value)
    robots.t = 1.0  # by the run, between two calls


def test_a_team_of_the_client_has_no_attribute_to_drive_by():
    with mock.patch.object(client, "_connected"):
        team = client.Team()
        with pytest.raises(AttributeError, match="'speed'"):
            team.speed = 0.1  # pyright: ignore[reportAttributeAccessIssue]
        team.patience = 2.0
