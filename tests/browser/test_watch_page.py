"""The page of a run in a real browser."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from browser.conftest import Seen, Server
from project_case import write_project
from watch_case import RESULT, add_trials, live_record, write_json, write_run

from softcal.plugins.watch.twin_panel import STILL, TURNED

SCRIPT = "<script>document.title='owned'</script><img src=x onerror=document.title='owned'>"
GL_NOISE = ("GPU stall due to ReadPixels", "GroupMarkerNotSet", "swiftshader", "SwiftShader")

Serve, Look = Callable[..., Server], Callable[..., Seen]


def complaints(seen: Seen) -> list[str]:
    """What the browser complained of, but for its notes on drawing without a graphics card."""
    return [text for text in seen.complaints if not any(noise in text for noise in GL_NOISE)]


def elsewhere(seen: Seen) -> list[str]:
    return [
        url
        for url in seen.requests
        if urlsplit(url).hostname not in ("127.0.0.1", "") and urlsplit(url).scheme not in ("data", "blob")
    ]


def status(address: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=60) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


@pytest.mark.slow
def test_the_page_follows_a_run_and_shows_names_as_text(tmp_path: Path, serve: Serve, look: Look):
    """Trials that come, a failure with its reason, workers, the end, the result, the report."""
    run = write_run(tmp_path / "run", labels=["joint", SCRIPT.replace("/", "|")[:60]], name=SCRIPT)
    place = run / "calibrations" / "joint"
    add_trials(place, [3.0, None, 2.0], name=SCRIPT, reason=SCRIPT)
    workers = [{"name": SCRIPT, "state": "busy", "done": 2}]
    live = live_record(os.getpid(), socket.gethostname(), now=datetime.now(UTC), workers=workers, stage=SCRIPT)
    write_json(place / "live.json", live)
    seen = look(serve(run, "--port", "0").address)
    seen.wait_for(lambda: seen.fact("trials") == "3 of at most 20", "three trials")
    assert (seen.fact("best"), seen.fact("failed")) == ("2", "1")
    assert seen.fact("time-note") == ""  # what its stage takes is not known
    assert seen.page.locator(".sc-state").inner_text() == "Running"
    assert seen.page.locator(".sc-name").inner_text() == SCRIPT
    seen.wait_for(lambda: seen.page.locator("td", has_text=SCRIPT).count() >= 3, "reason, parameter, worker as text")
    add_trials(place, [1.5], name=SCRIPT)
    write_json(place / "live.json", {**live, "stage": ""})
    seen.wait_for(lambda: (seen.fact("trials"), seen.fact("best")) == ("4 of at most 20", "1.5"), "the fourth trial")
    seen.wait_for(lambda: seen.fact("time-note") == "at most 32 s more at this rate", "the time that is left")
    write_json(place / "result.json", RESULT)
    write_figure(run, "trajectory-<i>")
    (run / "report.html").write_text(f"<html><body><h1>The report</h1>{SCRIPT}</body></html>")
    (place / "live.json").unlink()
    seen.page.locator("tr", has_text="joint").click()
    seen.wait_for(lambda: seen.page.locator(".sc-state").inner_text() == "Done", "the end")
    assert seen.page.locator("td", has_text="1.2 to 1.4 MPa").count() == 1
    assert seen.page.get_by_text("The slack is at a bound.").is_visible()
    drawn = seen.page.locator(".sc-figures img")
    seen.wait_for(lambda: drawn.count() == 1 and drawn.evaluate("one => one.naturalWidth") == 40, "the figure is shown")
    assert seen.page.locator("figcaption").inner_text() == "Trajectory <i>"
    with seen.page.context.expect_page() as opened:
        drawn.click()
    assert unquote(opened.value.url).partition("?")[0].endswith("/figures/trajectory-<i>.png")
    with seen.page.context.expect_page() as opened:
        seen.page.get_by_text("Open the report").click()
    assert opened.value.locator("h1").inner_text() == "The report"
    assert "owned" not in (seen.page.title(), opened.value.title())
    assert seen.page.locator("script", has_text="owned").count() == 0
    assert seen.page.locator("img[src=x]").count() == 0
    assert complaints(seen) == []
    assert elsewhere(seen) == []


def write_figure(run: Path, stem: str) -> None:
    from PIL import Image

    (run / "figures").mkdir()
    Image.new("RGB", (40, 30), "red").save(run / "figures" / f"{stem}.png")
    (run / "figures" / f"{stem}.svg").write_text("<svg/>")


@pytest.mark.slow
def test_a_page_for_other_machines_needs_its_token(tmp_path: Path, serve: Serve, look: Look):
    run = write_run(tmp_path / "run")
    (run / "report.html").write_text("<h1>The report</h1>")
    server = serve(run, "--host", "0.0.0.0", "--port", "0")
    token = urlsplit(server.address).query.removeprefix("token=")
    assert len(token) >= 43
    base = f"http://127.0.0.1:{server.port}"
    for path in (
        "/",
        "/report",
        "/twin/a.glb",
        "/figures/overview.png",
        "/favicon.ico",
        "/_nicegui_ws/socket.io/?EIO=4&transport=polling",
    ):
        assert status(base + path) == 403
        assert status(f"{base}{path}{'&' if '?' in path else '?'}token={token[:-1]}") == 403
        assert status(base + path, Cookie=f"softcal-{server.port}={token[:-1]}") == 403
    assert status(f"{base}/report?token={token}") == 200
    seen = look(f"{base}/?token={token}")
    seen.wait_for(lambda: seen.fact("trials") == "0 of at most 20", "the page")
    assert complaints(seen) == []


@pytest.mark.slow
def test_files_of_a_run_beside_its_report_are_not_served(tmp_path: Path, serve: Serve):
    run = write_run(tmp_path / "run")
    (tmp_path / "secret.txt").write_text("secret")
    base = serve(run, "--port", "0").address
    write_figure(run, "overview")
    (run / "figures" / "link.png").symlink_to(run / "run.json")
    assert status(base + "figures/overview.png") == 200
    figures = (
        "figures/../run.json",
        "figures/%2e%2e/run.json",
        "figures/..%2frun.json",
        "figures/link.png",
        "figures/",
    )
    climbing = (
        *figures,
        "figures/overview.svg",
        "../secret.txt",
        "%2e%2e/secret.txt",
        "twin/../run.json",
        "twin/%2e%2e%2frun.json.glb",
    )
    for path in (
        "run.json",
        "report",
        "docs",
        "openapi.json",
        "fit/a.png",
        *climbing,
        "_nicegui/3/static/../../../../etc/passwd",
    ):
        assert status(base + path) == 404, path


@pytest.mark.slow
def test_the_end_of_a_server_and_a_port_in_use(tmp_path: Path, serve: Serve):
    run = write_run(tmp_path / "run")
    server = serve(run, "--port", "0")
    again = subprocess.run(
        [sys.executable, "-m", "softcal", "watch", str(run), "--no-browser", "--port", str(server.port)],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert again.returncode == 2
    assert (
        f"127.0.0.1:{server.port}: the page cannot be served at this address; got address already in use"
        in again.stderr
    )
    server.process.send_signal(signal.SIGINT)
    assert server.process.wait(60) == 0
    assert server.process.stdout is not None
    assert server.process.stdout.read() == ""


@pytest.mark.long
def test_a_calibration_from_its_begin_to_its_report(tmp_path: Path, serve: Serve, look: Look):
    """Two browsers; trials and the best loss; the twin in three dimensions; the report."""
    project, run = write_project(tmp_path / "project"), tmp_path / "run"
    server = serve(run, "--wait", "--port", "0")
    one = look(server.address)
    one.wait_for(lambda: "There is no run in this folder yet." in one.page.inner_text("body"), "the page waits")
    command = [
        sys.executable,
        "-m",
        "softcal",
        "calibrate",
        str(project),
        "--method",
        "tpe",
        "--trials",
        "250",
        "--out",
        str(run),
    ]
    log = (tmp_path / "log").open("w")
    with log, subprocess.Popen(command, stdout=log, stderr=log) as search:
        counts: list[int] = []
        losses: list[float] = []

        def follows() -> bool:
            found = re.match(r"(\d+) of", one.fact("trials"))
            if found and one.fact("best") != "–":
                counts.append(int(found.group(1)))
                losses.append(float(one.fact("best")))
            return len(set(counts)) >= 4 or search.poll() is not None

        one.wait_for(follows, "trials")
        two = look(server.address, 420, 900)
        two.wait_for(lambda: two.fact("best") != "–", "a second browser")
        assert search.wait(300) == 0, (tmp_path / "log").read_text()
    assert counts == sorted(counts)
    assert len(set(counts)) >= 4
    assert losses == sorted(losses, reverse=True)
    for seen in (one, two):
        seen.wait_for(lambda seen=seen: seen.page.locator(".sc-state").inner_text() == "Done", "the end")
        assert seen.fact("trials") == "250 of 250"
    best = one.fact("best-note")
    one.wait_for(lambda: one.fact("twin").startswith(f"T{best[1:]}: front: "), "the twin at the best trial")
    assert re.fullmatch(r"[\d.]+ mm", one.fact("displacement"))
    fit = one.page.locator("section", has_text="Measured and simulated at the best trial").locator("img")
    one.wait_for(
        lambda: fit.count() == 1 and fit.evaluate("one => one.naturalWidth") > 500, "the fit at the best trial"
    )
    of_report = one.page.locator("section", has_text="Figures of the report").locator("figcaption")
    titles = {
        "Measured force and the twin",
        "Measured and simulated: pull",
        "The twin at rest and at its largest pitch",
    }
    assert titles <= set(of_report.all_inner_texts())
    one.wait_for(lambda: coloured(one) > 2000, "the twin is drawn")
    before = picture(one)
    box = one.page.locator("canvas[data-engine^=three]").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    drawn = "getElement(+document.querySelector('.sc-scene').id.slice(1)).fps"
    assert one.page.evaluate(drawn) == STILL
    one.page.mouse.move(*middle)
    one.wait_for(lambda: one.page.evaluate(drawn) == TURNED, "more pictures in a second where the mouse is")
    one.page.mouse.down()
    one.page.mouse.move(middle[0] + 120, middle[1], steps=6)
    one.page.mouse.up()
    one.wait_for(lambda: (np.abs(picture(one) - before).max(axis=2) > 40).sum() > 1000, "the twin turns")
    one.page.mouse.move(0, 0)
    one.wait_for(lambda: one.page.evaluate(drawn) == STILL, "fewer where it is not")
    assert one.page.get_by_text("Open the report").is_visible()
    for seen in (one, two):
        assert complaints(seen) == []
        assert elsewhere(seen) == []


@pytest.mark.long
def test_a_page_whose_server_went_and_came_back(tmp_path: Path, serve: Serve, look: Look):
    run = write_run(tmp_path / "run")
    place = run / "calibrations" / "joint"
    add_trials(place, [3.0])
    server = serve(run, "--port", "0")
    seen = look(server.address)
    seen.wait_for(lambda: seen.fact("best") == "3", "the first trial")
    server.kill()
    add_trials(place, [2.0])
    serve(run, "--port", str(server.port))
    seen.wait_for(
        lambda: seen.page.locator('[data-fact="best"]').count() == 1 and seen.fact("best") == "2", "the page recovers"
    )


def picture(seen: Seen) -> np.ndarray:
    """The view of the twin, RGB (height, width, 3)."""
    from PIL import Image

    shot = seen.page.locator(".sc-scene").screenshot()
    return np.asarray(Image.open(BytesIO(shot)).convert("RGB"), dtype=np.int64)


def coloured(seen: Seen) -> int:
    """Number of pixels of the view that are neither white nor grey."""
    return int((np.ptp(picture(seen), axis=2) > 30).sum())
