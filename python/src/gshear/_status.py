"""What has become of a run: its file, `status.json` and the lock of its folder."""

from __future__ import annotations

import fcntl
import json
import time
from pathlib import Path
from typing import Any

# Age (s) from which on a lock is stale of which the kernel of this machine knows nothing.
STALE = 300.0


def condition(folder: Path, run_id: str, *, finished: bool) -> tuple[str, str | None]:
    """Returns the state of a run, as `gshear-reduce info` names it, and why it failed.

    Args:
        folder: Folder of the run.
        run_id: Identity of the run; a status of another one does not count.
        finished: Whether its file has the digest of its last state.
    """
    if finished:
        return "finished", None
    try:
        status = json.loads((folder / "status.json").read_text(encoding="utf-8"))
        state, message, stage = status["state"], status["message"], status["stage"]
        is_of_run = run_id in ("", status["run_id"])
    except (OSError, ValueError, KeyError, TypeError):
        return "unfinished", None
    if not is_of_run:
        return "unfinished", None
    if state == "running":
        return ("killed" if _is_left(folder / "run.lock") else "running"), None
    if state == "failed":
        return "failed", f"{message or 'unknown'} (stage {stage})"
    return ("stopped" if state == "stopped" else "unfinished"), None


def _is_left(lock: Path) -> bool:
    """Whether there is no lock, or its process is gone."""
    try:
        if not lock.is_file():
            return True
        with lock.open(encoding="utf-8") as file:
            holder: Any = json.load(file)
            known = holder.get("locked") and holder.get("boot") == _boot()
            if not known:
                return time.time() - lock.stat().st_mtime > STALE
            # The kernel holds the lock for as long as the process lives.
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (OSError, ValueError, AttributeError):
        # About to be written or removed, or on a file system without locks.
        return False
    return True


def _boot() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8")
    except OSError:
        return ""
