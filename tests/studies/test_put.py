"""What is queued, with a repository whose lock and refusals are chosen."""

import io
import json
import sys
from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from dvc.exceptions import DvcException
from dvc.lock import LockError

from studies import put


@pytest.fixture
def queued(monkeypatch):
    """What `main` has queued; a name starting with `busy` is locked at the first try, `bad` is refused."""
    tries, done = [], []

    def run(*, queue, name, params):
        assert queue
        tries.append(name)
        if name.startswith("busy") and tries.count(name) == 1:
            raise LockError("a worker has it")
        if name.startswith("bad"):
            raise DvcException("no such key")
        done.append((name, params))

    repo = SimpleNamespace(experiments=SimpleNamespace(run=run))
    monkeypatch.setattr("dvc.repo.Repo", lambda: nullcontext(repo))
    monkeypatch.setattr(put.time, "sleep", lambda seconds: None)
    return done


def given(monkeypatch, *names):
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps({name: [f"seed={name}"] for name in names})))


def test_all_are_queued_in_their_order_and_a_lock_is_waited_for(monkeypatch, queued):
    given(monkeypatch, "first", "busy", "last")
    put.main()
    assert queued == [(name, [f"seed={name}"]) for name in ("first", "busy", "last")]


def test_what_is_refused_is_told_in_a_line(monkeypatch, queued):
    given(monkeypatch, "first", "bad", "last")
    with pytest.raises(SystemExit, match="ERROR: no such key"):
        put.main()
    assert [name for name, _ in queued] == ["first"]
