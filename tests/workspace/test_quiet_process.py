"""Workers leave Ctrl-C alone from their first moment."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

# A pool whose workers take long to import, in a group of processes of its own.
POOL = """
import concurrent.futures as futures
import signal, sys, time
from pathlib import Path
from pieper.workspace._quiet_process import QuietContext, leave_ctrl_c_alone

def work(n):
    return n * n

if __name__ == "__main__":
    signal.signal(signal.SIGINT, lambda *_: None)
    with futures.ProcessPoolExecutor(2, mp_context=QuietContext(), initializer=leave_ctrl_c_alone) as pool:
        waiting = [pool.submit(work, n) for n in range(4)]
        print("begun", flush=True)
        print(sum(each.result() for each in waiting), flush=True)
else:
    import time
    time.sleep(0.5)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a terminal there tells its processes otherwise")
def test_ctrl_c_while_workers_begin_does_not_reach_them(tmp_path):
    script = tmp_path / "pool.py"
    script.write_text(POOL)
    process = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    for _ in range(10):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.05)
    said, complaint = process.communicate(timeout=60)
    assert (said, complaint, process.returncode) == ("14\n", "", 0)
