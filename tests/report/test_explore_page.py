"""The page to explore in a real browser, opened as a file: clicks, wipes, reads back what it shows."""

import json
import shutil

import pandas as pd
import pytest

from report.browser import complaints, opened, programs, requests, wait
from report.explored import CAMERAS, DRAWN, GAPS, PLATE_GAPS_PX, STEPS, build_page, told_in, write_results
from reporting.explore_tables import as_js

CLICKS = 5

READY = "return window.explorer && explorer.state && document.getElementById('viewer').dataset.ready"
INSIDE = slice(100, 400), slice(250, 650)  # of the stage, on a desk: image, and nothing over it but the divider
MANY = 10_000
HOSTILE = '"><img src=x onerror="window.hit=1"></script><script>window.hit=1</script>'


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The results' folder of a small run, below a folder whose name a careless address would break."""
    programs()
    return write_results(tmp_path_factory.mktemp("run") / "Büro #1, O'Neill 100%")


@pytest.fixture(scope="module")
def window(run):
    """A browser that shows the run's page on a desk."""
    with opened(1400, 900) as window:
        show(window, run / "report/explore.html")
        yield window


def show(window, page, address=""):
    """Open a page anew and wait until its first capture is seen."""
    window.get("about:blank")
    window.get(page.as_uri() + address)
    return wait(window, READY)


def state(window):
    """Return what the page is showing."""
    return window.execute_script("return explorer.state()")


def text(window, selector):
    """Return the text of the first element of a selector."""
    return window.execute_script("return document.querySelector(arguments[0]).textContent", selector)


def click(window, selector):
    """Click the middle of an element, as a mouse does."""
    element = window.find_element("css selector", selector)
    window.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    element.click()


def press(window, *keys):
    """Type keys on the page."""
    from selenium.webdriver.common.action_chains import ActionChains

    window.execute_script("document.activeElement.blur()")
    ActionChains(window).send_keys(*keys).perform()


def brightness(window, selector):
    """Return the grey levels (rows, columns) of a part of the screen."""
    import cv2
    import numpy as np

    element = window.find_element("css selector", selector)
    window.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    return cv2.imdecode(np.frombuffer(element.screenshot_as_png, np.uint8), cv2.IMREAD_GRAYSCALE).astype(float)


def test_it_opens_from_a_folder_without_a_complaint(window):
    """Fails if a script, a style or an image is fetched in a way that a page from a file may not."""
    assert state(window)["viewer"]["loaded"] == 1 + len(STEPS)
    assert text(window, "#failed") == "" and complaints(window) == []
    assert wait(window, "return document.querySelector('#loupe').dataset.at")


def test_it_asks_nobody_else(window, run):
    """Fails if anything comes from an address that is no file: the page has to work offline."""
    requests(window)
    show(window, run / "report/explore.html")
    asked = [url for url in requests(window) if url != "about:blank"]
    assert len(asked) > 10 and all(url.startswith(("file:", "data:")) for url in asked)


def test_the_ladder_shows_gaps_and_what_each_effect_takes_away(window, run):
    """Fails if numbers of another rung or capture stand beside the slider."""
    show(window, run / "report/explore.html", "#camera=left")
    cells = told_in(run / "report/explore/left/cells_0000.js")[str(state(window)["capture"])]
    for k, step in enumerate(cells["steps"]):
        window.execute_script(
            "const s = document.getElementById('step'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))", k
        )
        assert text(window, "#rms") == f"{step['rms_dn']:.2f}"
        assert text(window, "#off") == f"{step['off_px']:.3f}"
        assert text(window, "dd[data-error=gap]").startswith(f"{GAPS[k]:.2f} floors")
        assert state(window)["viewer"]["step"] == k
    click(window, ".rung[data-step='0']")
    assert state(window)["step"] == 0


def test_the_divider_wipes_by_mouse_and_by_keys(window, run):
    """Fails if dragging moves the picture instead, or a keyboard cannot wipe."""
    from selenium.webdriver.common.action_chains import ActionChains

    show(window, run / "report/explore.html")
    click(window, "#modes [value=wipe]")
    divider = window.find_element("css selector", ".divider")
    width = window.execute_script("return document.getElementById('viewer').clientWidth")
    ActionChains(window).click_and_hold(divider).move_by_offset(-int(width / 4), 0).release().perform()
    assert abs(state(window)["viewer"]["share"] - 0.25) < 0.01
    divider.send_keys("\ue014")  # right
    assert abs(state(window)["viewer"]["share"] - 0.27) < 0.01


def test_what_is_wiped_is_seen(window, run):
    """Fails if the twin is drawn over all of the capture, or over the wrong side of the divider."""
    show(window, run / "report/explore.html", "#camera=left&step=0")
    window.execute_script("document.getElementById('outlines').click()")
    divider = window.find_element("css selector", ".divider")
    seen = {}
    for key, name in (("\ue011", "twin"), ("\ue010", "capture")):  # home, end
        divider.send_keys(key)
        wait(window, "return new Promise((go) => setTimeout(() => go(true), 400))")
        seen[name] = brightness(window, ".stage")
    press(window, "b")
    for _ in range(2):
        press(window, " ")
        wait(window, "return new Promise((go) => setTimeout(() => go(true), 400))")
        blinked = brightness(window, ".stage")
        shown = window.execute_script("return document.getElementById('viewer').dataset.shown")
        other = "twin" if shown == "capture" else "capture"
        off = {name: abs(blinked[INSIDE] - seen[name][INSIDE]).mean() for name in seen}
        assert off[shown] < 0.3 * off[other]


def test_the_difference_goes_dark_with_the_effect(window, run):
    """Fails if the difference is not that of the capture and this rung's twin."""
    show(window, run / "report/explore.html", "#camera=left&step=0&mode=difference")
    window.execute_script("document.getElementById('outlines').click()")
    light = []
    for key in ("0", "\ue013"):  # the whole image, up the ladder
        press(window, key)
        wait(window, "return new Promise((go) => setTimeout(() => go(true), 500))")
        light.append(brightness(window, ".stage")[INSIDE].mean())
    assert light[1] < 0.7 * light[0]


def test_a_click_on_a_plate_shows_what_was_measured(window, run):
    """Fails if the rig's map or the picture select another marker, or numbers of another detector are shown."""
    show(window, run / "report/explore.html", "#camera=left")
    markers = pd.read_csv(run / "expand/markers.csv")
    capture = told_in(run / "report/explore/left/camera.js")["captures"]["name"][state(window)["capture"]]
    table = pd.read_parquet(run / "compare/left.parquet")
    table = table[(table.capture == capture) & (table.detector == "bart") & (table.twin_is == "ideal") & table.paired]
    for row in table.head(2).itertuples():
        marker = markers.index[(markers.dictionary == row.dictionary) & (markers.id == row.id)][0]
        click(window, f"#map [data-marker='{marker}']")
        assert text(window, "#marker-name") == f"{row.dictionary}/{row.id}"
        shown = "#found tr:nth-child(2) [data-value={}]"
        assert text(window, shown.format("real")) == "found"
        assert text(window, shown.format("distance-real")) == f"{row.distance_real_m:.3f}"
        assert text(window, shown.format("distance-before")) == f"{row.distance_twin_m:.3f}"
    offs = [float(text(window, f"[data-off='{k}']")) for k in (0, 1)]
    assert offs[1] < offs[0]


def test_a_click_in_the_picture_finds_the_marker_under_it(window, run):
    """Fails if pixels of the screen and of the capture are mixed up, or half a pixel is lost at eight times."""
    from selenium.webdriver.common.action_chains import ActionChains

    show(window, run / "report/explore.html", "#camera=left&marker=DICT_5X5_1000/2")
    viewer = window.find_element("css selector", "#viewer .stage")
    for _ in range(CLICKS):  # a picture that is still being laid out moves away from under the pointer
        other = window.execute_script("""
            const box = document.querySelector('.outlines [data-marker="3"]').getBoundingClientRect();
            const stage = document.getElementById('viewer').getBoundingClientRect();
            return [box.x + box.width / 2 - stage.x - stage.width / 2, box.y + box.height / 2 - stage.y - stage.height / 2]""")
        ActionChains(window).move_to_element_with_offset(viewer, *map(round, other)).click().pause(0.3).perform()
        if window.execute_script("return explorer.state().marker") == 3:
            break
    wait(window, "return explorer.state().marker === 3")
    size = wait(window, "const size = document.querySelector('#loupe canvas').width; return size > 1 && size")
    assert size % 16 == 0  # whole squares of eight, as many on both sides


def test_filters_leave_what_they_say(window, run):
    """Fails if the map counts plates that a filter excludes, or a choice cannot be taken back."""
    show(window, run / "report/explore.html", "#camera=left")
    told = told_in(run / "report/explore/left/camera.js")
    near = window.execute_script("return [...document.querySelectorAll('#map .plate')].map((p) => p.dataset.value)")
    assert all(abs(float(v) - PLATE_GAPS_PX["configured"]) < 1e-6 for v in near)
    click(window, "#when [value='1']")
    after = window.execute_script(
        "return [...document.querySelectorAll('#map .plate')].map((p) => Number(p.dataset.value))"
    )
    assert all(abs(v - PLATE_GAPS_PX["explained"]) < 1e-6 for v in after)
    first = min(row[2] for row in told["plates"])
    click(window, f"#distances [value='{first}']")
    values = window.execute_script("return [...document.querySelectorAll('#map .plate')].map((p) => p.dataset.value)")
    there = {row[3] for row in told["plates"] if row[2] == first}
    assert {k for k, v in enumerate(values) if v} == there and len(there) < len(values)
    click(window, f"#distances [value='{first}']")
    assert state(window)["kept"] == len(told["captures"]["name"])


def test_keys_reach_everything(window, run):
    """Fails if a reader without a mouse cannot turn captures, add effects, change the way of comparing."""
    show(window, run / "report/explore.html", "#camera=left")
    start = state(window)
    press(window, "\ue014")
    wait(window, "return explorer.state().capture !== arguments[0]", start["capture"])
    press(window, "\ue013", "d", "m")
    now = state(window)
    assert (now["step"], now["mode"]) == (1, "difference") and now["marker"] != start["marker"]
    assert "step=1" in window.current_url and "mode=difference" in window.current_url
    window.refresh()
    wait(window, READY)
    again = state(window)
    assert [again[k] for k in ("capture", "step", "mode", "marker")] == [
        now[k] for k in ("capture", "step", "mode", "marker")
    ]


def test_captures_that_are_not_drawn_say_so(window, run):
    """Fails if a twin at its station is taken for one in the capture's own pose."""
    captures = told_in(run / "report/explore/left/camera.js")["captures"]
    name = captures["name"][captures["drawn"].index(0)]
    show(window, run / "report/explore.html", f"#camera=left&capture={name}")
    assert state(window)["viewer"]["loaded"] == 1 and "station's tolerance" in text(window, "#how")
    assert captures["drawn"].count(1) == DRAWN


def test_it_fits_a_phone(run):
    """Fails if anything is wider than the screen, or a finger cannot wipe."""
    with opened(390, 844, touch=True) as phone:
        show(phone, run / "report/explore.html")
        assert phone.execute_script("return document.documentElement.scrollWidth") <= 390
        small = phone.execute_script("""return [...document.querySelectorAll('main button, .filters button')].filter((b) =>
            b.offsetParent && !b.closest('.map') && Math.min(b.offsetWidth, b.offsetHeight) < 30).map((b) => b.outerHTML)""")
        assert small == []
        box = phone.execute_script(
            "const d = document.querySelector('.divider'); d.scrollIntoView({block: 'center', behavior: 'instant'});"
            "const b = d.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]"
        )
        touch = {"x": box[0], "y": box[1]}
        phone.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [touch]})
        for x in (box[0] - 50, box[0] - 90):
            phone.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [touch | {"x": x}]})
        phone.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        wait(phone, "return explorer.state().viewer.share < 0.35")


def copied(run, folder):
    """Copy a run's report and tables, to be changed."""
    for part in ("report", "expand", "tables"):
        shutil.copytree(run / part, folder / part)
    return folder


def test_names_are_text_whatever_they_hold(run, tmp_path, window):
    """Fails if a marker's, capture's or campaign's name becomes markup: pages would run untrusted code."""
    results = copied(run, tmp_path)
    markers = pd.read_csv(results / "expand/markers.csv")
    markers.assign(dictionary=HOSTILE + markers.dictionary).to_csv(results / "expand/markers.csv", index=False)
    scene = results / "expand/scene.json"
    scene.write_text(json.dumps(json.loads(scene.read_text()) | {"name": HOSTILE}))
    script = results / "report/explore/left/camera.js"
    told = told_in(script)
    told["captures"]["name"] = [f"{HOSTILE}{k}" for k in range(len(told["captures"]["name"]))]
    told["steps"][1]["effect"] = told["verdict"] = told["tilts"][0] = HOSTILE
    script.write_text(as_js("camera/left", told), encoding="utf-8")
    show(window, build_page(results))
    assert window.execute_script("return window.hit || document.querySelectorAll('img').length") == 0
    assert (
        HOSTILE in text(window, "#capture")
        and HOSTILE in text(window, "#marker-name")
        and HOSTILE in text(window, "h1")
    )
    assert window.title.startswith(HOSTILE)


def test_ten_thousand_captures_open_as_quickly(run, tmp_path, window):
    """Fails if images, rows or numbers of captures that nobody asked for are loaded."""
    results = copied(run, tmp_path)
    script = results / "report/explore/left/camera.js"
    told = told_in(script)
    count = len(told["captures"]["name"])
    for name, column in told["captures"].items():
        told["captures"][name] = [f"capture_{k:05d}" if name == "name" else column[k % count] for k in range(MANY)]
    for name in ("in_bins", "stands"):
        told[name] = [told[name][k % count] for k in range(MANY)]
    script.write_text(as_js("camera/left", told), encoding="utf-8")
    requests(window)
    show(window, build_page(results), "#camera=left")
    assert text(window, "#kept") == f"{MANY} of {MANY}"
    assert window.execute_script("return document.querySelectorAll('#list button').length") < 60
    images = {url for url in requests(window) if url.endswith((".png", ".jpg"))}
    assert 0 < len(images) <= 2 + len(STEPS)
    filtering = """const t = performance.now(); document.getElementById('sort').value = 'before_px';
        document.getElementById('sort').dispatchEvent(new Event('change')); return performance.now() - t"""
    assert window.execute_script(filtering) < 2000
    window.execute_script("document.getElementById('list').scrollTop = 36 * 9000")
    wait(window, "return [...document.querySelectorAll('#list button')].some((b) => Number(b.dataset.capture) > 8000)")


def test_a_part_that_is_missing_is_named(run, tmp_path, window):
    """Fails if a page whose folder was left behind stays empty without a word."""
    results = copied(run, tmp_path)
    shutil.rmtree(results / "report/explore" / CAMERAS[0])
    window.get((results / "report/explore.html").as_uri())
    assert "camera.js is missing" in wait(window, "return document.getElementById('failed').textContent")
