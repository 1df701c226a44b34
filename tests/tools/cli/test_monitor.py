import io
import sys

import pytest

from panoloc_mcl.tools.cli.monitor import LineMonitor, monitor


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def test_lines_are_sparse(capsys, clock):
    lines = LineMonitor()
    for done in range(1, 101):
        clock[0] += 0.5
        lines.progress(done, 100, "references")
    found = capsys.readouterr().err.splitlines()
    assert found[-1] == "references: 100/100"
    assert 5 <= len(found) <= 11


def test_what_is_quick_is_one_line(capsys, clock):
    lines = LineMonitor()
    for done in range(1, 21):
        lines.progress(done, 20, "references")
    lines.notice("a sequence\nhas no odometry")
    assert capsys.readouterr().err == "references: 20/20\nnote: a sequence has no odometry\n"


def test_no_bars_where_there_is_no_terminal():
    with monitor() as watching:
        assert isinstance(watching, LineMonitor)


def test_bars_on_a_terminal(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with monitor() as watching:
        for what in ("rendering", "references"):
            for done in range(1, 4):
                watching.progress(done, 3, what)
        watching.notice("has no odometry")
    assert "3/3" in terminal.getvalue()
    assert "/s" in terminal.getvalue()
    assert "note: has no odometry" in terminal.getvalue()
