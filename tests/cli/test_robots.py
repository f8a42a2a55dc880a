"""``pieper robots``."""

from tests.robots import ROBOTS


def test_every_robot_is_listed(pieper_command) -> None:
    listed = pieper_command("robots", "--json").json["robots"]
    assert [(r["name"], r["joints"], tuple(sorted(r["aliases"]))) for r in listed] == [
        (robot.name, robot.dof, tuple(sorted(robot.aliases))) for robot in sorted(ROBOTS)
    ]
    assert all(r["source"]["licence"] for r in listed)


def test_the_list_fits_80_columns(pieper_command) -> None:
    lines = pieper_command("robots").out.splitlines()
    assert max(map(len, lines)) <= 80
    for robot in ROBOTS:
        assert any(line.startswith(robot.name + " ") for line in lines)
