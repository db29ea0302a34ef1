"""`pzt panel` before anything is served: options that do not fit, where to join, and who gets a token."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from pzt_ros import graphs
from pzt_ros.cli import panel
from pzt_ros.cli.app import build
from pzt_ros.errors import BenchError


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, dict[str, Any]]]:
    """What would have been served: the feed and its options."""
    calls: list[tuple[Any, dict[str, Any]]] = []
    monkeypatch.setattr(panel, "_serve", lambda: lambda feed, **options: calls.append((feed, options)))
    return calls


def refused(*words: str) -> str:
    result = CliRunner().invoke(build(), ["panel", *words])
    assert isinstance(result.exception, BenchError), result.output
    return str(result.exception)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--attach", "--bag", "x"), "exclude each other"),
        (("--attach", "--out", "x"), "belong to a graph that is started"),
        (("--bag", "x", "--drivers", "y"), "belong to a graph that is started"),
        (("--bag", "x", "--domain", "3"), "a bag has no ROS domain"),
        (("--bag", "/nowhere"), "no such bag"),
    ],
)
def test_what_does_not_fit_is_refused(served: list[Any], words: tuple[str, ...], why: str) -> None:
    assert why in refused(*words)
    assert served == []


def test_a_scenario_that_is_none_gives_up(served: list[Any], tmp_path: Path) -> None:
    assert "the graph did not start" in refused("nonsense", "--out", str(tmp_path / "run"))
    assert served == []


def test_a_token_is_wanted_only_elsewhere(served: list[Any]) -> None:
    for host in ("127.0.0.1", "0.0.0.0"):
        result = CliRunner().invoke(build(), ["panel", "--attach", "--domain", "42", "--host", host, "--no-browser"])
        assert result.exit_code == 0, result.output
        token = served[-1][1]["token"]
        assert bool(token) == (host == "0.0.0.0")
        assert f"http://{host}:8080/" in result.output
        assert not token or f"?token={token}" in result.output


def test_the_node_is_told_domain_namespace_and_whether_it_may_command(served: list[Any]) -> None:
    words = ["panel", "--attach", "--domain", "42", "--namespace", "/lab/x", "--read-only", "--no-browser"]
    assert CliRunner().invoke(build(), words).exit_code == 0
    feed = served[-1][0]
    assert feed.read_only
    assert feed._environment["ROS_DOMAIN_ID"] == "42"
    assert feed._command[-4:] == ["-r", "__ns:=/lab/x", "-p", "read_only:='true'"]


@pytest.fixture
def locks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(graphs.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    return tmp_path


def test_the_one_graph_that_runs_is_joined(locks: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert panel._domain_to_join(None) == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", "5")
    assert panel._domain_to_join(None) == 5
    held = []
    for domain in (17, 23):
        file = graphs.lock_file(domain).open("a+")
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(str(os.getpid()))
        file.flush()
        held.append(file)
        if domain == 17:
            assert graphs.running_graphs() == {17: os.getpid()}
            assert panel._domain_to_join(None) == 17
    with pytest.raises(BenchError, match=r"run in the ROS domains 17, 23; name one"):
        panel._domain_to_join(None)
    assert panel._domain_to_join(4) == 4
    for file in held:
        file.close()
    assert graphs.running_graphs() == {}


def test_without_nicegui_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = __import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name == "pzt_ros.panel.serve":
            raise ModuleNotFoundError("No module named 'nicegui'", name="nicegui")
        return real(name, *rest, **more)

    monkeypatch.setattr("builtins.__import__", without)
    with pytest.raises(BenchError, match=r"pip install 'pzt_ros\[panel\]'"):
        panel._serve()
