"""The page in headless Chromium: sliders move parts by their joints, and nothing is asked for.

Where no Chromium is installed (Debian: `apt-get install chromium`) these are skipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from synth import toy_cabinet_twin

from part2gs_robotics.model.kinematics import part_transforms
from part2gs_robotics.report.data import Picture, ReportData
from part2gs_robotics.report.report_json import write_report

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
TWIN = toy_cabinet_twin(4)
PLACES = """twin.groups.map(group => {
  group.updateWorldMatrix(true, false); return [...group.matrixWorld.elements]; })"""
HOME, END, LEFT, RIGHT = ("Home", 36), ("End", 35), ("ArrowLeft", 37), ("ArrowRight", 39)


def page(folder: Path) -> Path:
    photo = np.full((30, 40, 3), 180, np.uint8)
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, -1], [1, 0, 0], [0, -1, 0]]  # looks along -x, z up
    pose[:3, 3] = (3.0, 0.3, 0.4)
    pictures = tuple(Picture(f"state {state}", state, photo, photo, photo // 2,
                             world_from_camera=pose, fov=0.8)
                     for state in (0, 1))
    write_report(folder, ReportData("cabinet", "artgs", 0, TWIN, pictures=pictures))
    return folder / "report.html"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as found:
        found.open(page(tmp_path_factory.mktemp("page")))
        yield found


def placed(browser: Browser) -> list[np.ndarray]:
    """Return what the page's scene graph says: world_at_q_from_world_at_0 per part, as it draws."""
    centre = np.eye(4)
    centre[:3, 3] = browser.run("twin.data.centre")
    return [centre @ np.array(m).reshape(4, 4).T @ np.linalg.inv(centre)
            for m in browser.run(PLACES)]


def test_keys_on_a_slider_turn_the_door_by_the_angle_shown(browser: Browser) -> None:
    browser.run("document.getElementById('joint-2').focus()")
    for key, q in ((END, 1.5), (LEFT, 1.4985), (HOME, 0.0), (RIGHT, 0.0015)):
        browser.press(*key)
        browser.wait(f"Math.abs(twin.at[2] - {q}) < 1e-9")
        door, lever = placed(browser)[2:4]
        turn = np.arctan2(door[0, 1], door[0, 0])  # about -z
        assert turn == pytest.approx(q, abs=1e-9)
        np.testing.assert_allclose(door, lever, atol=1e-12, err_msg="the lever rides on the door")
        assert browser.run("document.getElementById('value-2').textContent") == (
            f"{np.degrees(q):.1f}°")


def test_every_pose_of_the_scene_graph_is_that_of_the_kinematics(browser: Browser) -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        q = rng.uniform([0, 0, 0, 0], [0.25, 1.5, 0.5, 2.0])
        for i, value in enumerate(q, 1):
            browser.run(f"twin.place({i}, {value})")
        for ours, theirs in zip(part_transforms(TWIN, q.tolist()), placed(browser), strict=True):
            np.testing.assert_allclose(theirs, ours, atol=1e-9)


@pytest.mark.parametrize("state", [1, 0])
def test_the_buttons_go_to_the_observed_states(browser: Browser, state: int) -> None:
    browser.run(f"document.getElementById('state-{state}').click()")
    values = [part.joint.value * state for part in TWIN.parts[1:]]
    browser.wait(f"{values}.every((q, i) => Math.abs(q - twin.at[i + 1]) < 1e-9)")
    for ours, theirs in zip(part_transforms(TWIN, values), placed(browser), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-9)


def test_one_kind_of_shape_is_seen_at_a_time(browser: Browser) -> None:
    for kind in ("pieces", "surface"):
        browser.run(f"document.querySelector('input[value={kind}]').click()")
        shown = "Object.keys(twin.shown).filter(key => twin.shown[key].some(x => x.visible))"
        seen = browser.run(shown)
        assert seen == [kind]


def test_the_wipe_follows_its_slider_and_the_view_a_photo(browser: Browser) -> None:
    browser.run("document.querySelector('.wipe input').focus()")
    browser.press(*END)
    assert browser.run("document.querySelector('.wipe').style.getPropertyValue('--at')") == "100%"
    browser.run("document.querySelector('[data-camera=\"1\"]').click()")
    eye = browser.run("""(() => { const v = twin.view;
        return [v.far, v.above, v.fov, ...v.target.toArray()]; })()""")
    centre = np.array(browser.run("twin.data.centre"))
    assert eye[0] == pytest.approx(3.0 - centre[0])
    np.testing.assert_allclose(eye[1:3], [0.0, np.degrees(0.8)], atol=1e-9)


def test_the_wipe_shows_gaussians_or_meshes_as_chosen(browser: Browser) -> None:
    seen = """[...document.querySelectorAll('.wipe .over')].filter(
        image => getComputedStyle(image).display !== 'none').map(image => image.alt)"""
    for value, name in (("mesh", "render of the meshes"), ("splats", "render")):
        browser.run(f"document.querySelector('[name=wiped][value={value}]').click()")
        assert browser.run(seen) == [name, name]


@pytest.mark.parametrize(("width", "phone"), [(1280, False), (390, True), (320, True)])
def test_the_page_fits_its_window_and_every_control_has_a_name(
        browser: Browser, width: int, phone: bool) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=800,
                 deviceScaleFactor=1, mobile=phone)
    assert browser.run("document.documentElement.scrollWidth") <= width
    nameless = browser.run("""[...document.querySelectorAll('input, button, canvas, img')].filter(
        item => !(item.labels?.length || item.getAttribute('aria-label') || item.alt
                  || item.textContent.trim())).map(item => item.outerHTML)""")
    assert nameless == []
    columns = "getComputedStyle(document.querySelector('.first')).gridTemplateColumns.split(' ')"
    assert len(browser.run(columns)) == (1 if phone else 2)


# Every text on the nearest painted background below it, by the formula of WCAG 2.
CONTRAST = """(() => {
  const rgb = css => css.match(/[0-9.]+/g).map(Number);
  const bright = css => { const [r, g, b] = rgb(css).map(v => {
    v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const below = item => { while (item) { const css = getComputedStyle(item).backgroundColor;
    if (rgb(css)[3] !== 0) return css; item = item.parentElement; } return 'rgb(255, 255, 255)'; };
  const out = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) { const item = walk.currentNode.parentElement;
    if (!walk.currentNode.data.trim() || !item.getClientRects().length) continue;
    const pair = [getComputedStyle(item).color, below(item)].map(bright);
    const [low, high] = pair.sort((a, b) => a - b);
    const ratio = (high + 0.05) / (low + 0.05);
    if (ratio < 4.5) out.push([walk.currentNode.data.trim().slice(0, 40), ratio]); }
  return out; })()"""


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_every_text_stands_out_from_what_is_behind_it(browser: Browser, theme: str) -> None:
    browser.call("Emulation.setEmulatedMedia",
                 features=[{"name": "prefers-color-scheme", "value": theme}])
    assert browser.run("document.body.innerText.length") > 500
    assert browser.run(CONTRAST) == []


def test_nothing_was_asked_for_and_nothing_complained(browser: Browser) -> None:
    asked = [url for url in browser.requests if not url.startswith("data:")]
    assert len(asked) == 1, "the page itself"
    assert asked[0].startswith("file:")
    assert browser.complaints == []


def test_something_is_drawn_and_it_moves(browser: Browser, tmp_path: Path) -> None:
    import cv2

    browser.call("Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1,
                 mobile=False)
    browser.run("scrollTo(0, 0)")

    def settled(value: float) -> np.ndarray:
        """Return the page once two photographs of it are the same: a new size takes frames."""
        browser.run(f"twin.place(2, {value})")
        last = None
        for _ in range(20):
            browser.run("new Promise(done => requestAnimationFrame(() => "
                        "requestAnimationFrame(done)))")
            browser.photograph(tmp_path / "shot.png")
            now = cv2.imread(str(tmp_path / "shot.png")).astype(int)
            if last is not None and now.shape == last.shape and (now == last).all():
                break
            last = now
        return now

    changed = (abs(settled(0.0) - settled(1.5)).max(2) > 20).mean()
    assert changed > 0.004, "an open door looks different"  # it is a hundredth of the page at least


def test_without_webgl_the_page_says_so_and_shows_the_rest(tmp_path: Path) -> None:
    with Browser(tmp_path / "profile", "--disable-3d-apis") as plain:
        plain.open(page(tmp_path))
        seen = "getComputedStyle(document.querySelector('.{}')).display"
        assert plain.run(seen.format("no3d")) == "block"
        assert plain.run(seen.format("controls .needs3d")) == "none"
        assert plain.run("document.querySelectorAll('.beside img').length") == 2
        assert plain.run("document.querySelector('.wipe').style.getPropertyValue('--at')") == "50%"
        assert "part_2 turns by 68.8" in str(plain.run("document.body.innerText"))


def test_who_wants_no_motion_gets_none(tmp_path: Path) -> None:
    with Browser(tmp_path / "profile", "--force-prefers-reduced-motion") as calm:
        calm.open(page(tmp_path))
        assert calm.run("document.getElementById('play').hidden")
        calm.run("document.getElementById('state-1').click()")
        calm.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        assert calm.run("twin.at[2]") == pytest.approx(1.2)
