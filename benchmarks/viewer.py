"""What does the viewer in the browser cost?

* an update of an arm with seven joints and eight ghosts: processor time of the whole server process, sending included, with one
  client that takes everything in;
* from ``pieper view`` typed to a picture in a browser that is open already;
* memory while an arm is jogged at random: as many pictures as an hour has at 30 a second, as fast as they can be made.

    python benchmarks/viewer.py [--pictures 108000] [--rounds 3]

The browser is Chromium without a graphics card, which draws in software; without one that part is left out.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import results
import viser

import pieper
from pieper.sim.kinematic import KinematicSimulator
from pieper.viewer.arm_view import ArmView, GhostsView
from pieper.viewer.jog import random_pose
from pieper.viewer.server import Server
from pieper.viewer.view import PERIOD, View

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = "--headless=new --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist"
SETTLED = 0.1  # of the run, after which memory is compared


class Client:
    """Somebody who looks on, and throws everything away: in a process of its own, so that only the server is measured."""

    CODE = """
import sys, websockets.sync.client
port, cookie, protocol = sys.argv[1:]
with websockets.sync.client.connect(f"ws://127.0.0.1:{port}", origin=f"http://127.0.0.1:{port}", subprotocols=[protocol],
        additional_headers={"Cookie": cookie}, proxy=None, max_size=None) as connection:
    print("connected", flush=True)
    while True:
        connection.recv()
"""

    def __init__(self, server):
        with urllib.request.urlopen(server.url) as answer:
            cookie = answer.headers["Set-Cookie"].partition(";")[0]
        self.process = subprocess.Popen(
            [sys.executable, "-c", self.CODE, str(server.port), cookie, f"viser-v{viser.__version__}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.process.stdout.readline() == "connected\n"

    def close(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


def update_cost(updates=600):
    """Processor milliseconds of one update of an arm and eight ghosts, 30 times a second."""
    arm = pieper.load("panda")
    server = Server(port=0)
    view, ghosts = ArmView(server, "arm", arm), GhostsView(server, "ghosts", arm)
    client = Client(server)
    rng = np.random.default_rng(0)
    qs = rng.uniform(*arm.limits.T, (updates, 9, arm.dof))
    found = {}
    for title, pause in (("at 30 Hz, sending included", PERIOD), ("at once, one after another", 0.0)):
        time.sleep(1.0)
        before = time.process_time()
        for q in qs:
            with server.atomic():
                view.update(q[0])
                ghosts.update(q[1:])
            time.sleep(pause)
        found[title] = 1e3 * (time.process_time() - before) / updates
    client.close()
    server.stop()
    return found


def first_picture(rounds):
    """Seconds from the command to its address, to the panel, and to the arm in the picture."""
    from io import BytesIO

    from PIL import Image
    from playwright.sync_api import sync_playwright

    marks = []
    with sync_playwright() as runner:
        browser = runner.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        for _ in range(rounds):
            page = browser.new_context(viewport={"width": 960, "height": 640}).new_page()
            began = time.perf_counter()
            process = subprocess.Popen(
                [sys.executable, "-m", "pieper", "view", "mh12", "--port", "0", "--no-browser"],
                stdout=subprocess.PIPE,
                text=True,
            )
            url = re.search(r"http\S+", process.stdout.readline())[0]
            address = time.perf_counter() - began
            page.goto(url, wait_until="commit")
            page.get_by_role("tab", name="Jog").first.wait_for()
            panel = time.perf_counter() - began
            while True:
                picture = np.asarray(Image.open(BytesIO(page.screenshot())).convert("RGB"), dtype=int)[:, :600]
                if np.count_nonzero((picture[..., 0] > 150) & (picture[..., 2] < 90)) > 500:  # the orange of the links
                    break
            marks.append([address, panel, time.perf_counter() - began])
            page.context.close()
            process.terminate()
            process.communicate()
        browser.close()
    address, panel, seen = np.median(marks, axis=0)
    return {"address printed": address, "panel there": panel, "arm in the picture": seen, "rounds": rounds}


def memory(pictures):
    """Resident memory of the server [MB] while the arm goes from one random pose to the next."""
    arm = pieper.load("ur5e")
    rng = np.random.default_rng(0)
    samples = []
    with View(Server(port=0), arm, KinematicSimulator(arm.chain)) as view:
        client = Client(view.server)
        for picture in range(pictures):
            if picture % 60 == 0:
                view.command(random_pose(arm, rng))
            view.step(PERIOD)
            if picture % max(1, pictures // 100) == 0:
                samples.append(resident())
            if picture % 16 == 0:
                time.sleep(0.005)  # the sending thread has its turn
        client.close()
    samples = np.array(samples)
    settled = samples[int(SETTLED * len(samples)) :]
    slope = float(
        np.polyfit(np.linspace(0.0, pictures * PERIOD / 3600.0, len(samples))[-len(settled) :], settled, 1)[0]
    )
    return {
        "pictures": pictures,
        "hours at 30 Hz": pictures * PERIOD / 3600.0,
        "start MB": float(samples[0]),
        "settled MB": float(settled[0]),
        "end MB": float(samples[-1]),
        "MB per hour": slope,
    }


def resident():
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=int, default=108_000)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    found = {"update of 7 joints and 8 ghosts [ms]": update_cost()}
    print(found, flush=True)
    if CHROMIUM is not None:
        found["first picture [s]"] = first_picture(options.rounds)
        print(found["first picture [s]"], flush=True)
    found["memory"] = memory(options.pictures)
    print(found["memory"], flush=True)
    path = results.save(
        "viewer",
        method="processor time of the server process over 600 updates; medians of wall times; resident memory 100 times over the run",
        packages=["viser", "websockets", "playwright"],
        figures=results.rounded(found),
    )
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
