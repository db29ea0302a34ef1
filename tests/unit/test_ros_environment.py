"""What nodes find in their environment: our transport where the user has not chosen one."""

from __future__ import annotations

from pathlib import Path

import pytest

from pzt_ros.ros_environment import ros_environment

NAMES = (
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_DOMAIN_ID",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
)
PROFILES = Path(__file__).parents[2] / "msgs_config"
FOR_OTHER_TOOLS = str(PROFILES / "fastdds.xml")


def seen(monkeypatch: pytest.MonkeyPatch, **given: str) -> dict[str, str]:
    """What a node of a user with these settings finds of them; profiles by their file name."""
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, text in given.items():
        monkeypatch.setenv(name, text)
    found = ros_environment(Path("logs"), domain=7)
    assert found["ROS_LOG_DIR"] == "logs"
    assert found["ROS_DOMAIN_ID"] == "7"
    words = {name: found[name] for name in NAMES if name in found and name != "ROS_DOMAIN_ID"}
    words["FASTRTPS_DEFAULT_PROFILES_FILE"] = Path(words["FASTRTPS_DEFAULT_PROFILES_FILE"]).name
    return words


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        {"ROS_LOCALHOST_ONLY": "1"},
        {"ROS_DOMAIN_ID": "3", "FASTRTPS_DEFAULT_PROFILES_FILE": FOR_OTHER_TOOLS},
    ],
)
def test_this_machine_means_udp_on_the_loopback_interface(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str]
) -> None:
    assert seen(monkeypatch, **given) == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        "FASTRTPS_DEFAULT_PROFILES_FILE": "fastdds_loopback.xml",
    }


def test_a_network_is_the_users_wish_and_means_udp_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    assert seen(monkeypatch, ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET") == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "FASTRTPS_DEFAULT_PROFILES_FILE": "fastdds.xml",
    }


@pytest.mark.parametrize(
    "given",
    [
        {"FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA"},
        {"ROS_STATIC_PEERS": "192.168.0.7"},
        {"FASTRTPS_DEFAULT_PROFILES_FILE": "/home/me/mine.xml", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
    ],
)
def test_who_has_chosen_a_transport_keeps_it(monkeypatch: pytest.MonkeyPatch, given: dict[str, str]) -> None:
    ours = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "FASTRTPS_DEFAULT_PROFILES_FILE": "fastdds.xml"}
    kept = {name: Path(text).name for name, text in given.items()}
    assert seen(monkeypatch, **given) == {**ours, **kept}


def test_a_program_that_is_started_by_a_node_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    first = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}
    loopback = str(PROFILES / "fastdds_loopback.xml")
    assert seen(monkeypatch, FASTRTPS_DEFAULT_PROFILES_FILE=loopback, **first)["ROS_AUTOMATIC_DISCOVERY_RANGE"] == (
        "SYSTEM_DEFAULT"
    )
