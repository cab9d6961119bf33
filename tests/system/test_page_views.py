"""The page's views of what needs a person, in Debian's chromium, with a stand-in cell."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from support.served_page import served_page
from support.source import ROOT
from system.test_page import CHROMIUM, PAGE, browser, playwright  # noqa: F401
from unit.skiros2_gateway.conftest import TOKENS

AXE = ROOT / ".venv/page/node_modules/axe-core/axe.min.js"
RULES = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice")
SIZES = {"panel": (1280, 800, "light"), "dark": (1280, 800, "dark"), "phone": (390, 844, "light")}

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium"),
    pytest.mark.skipif(not PAGE.is_file(), reason="the page is not built: npm had no network at the set-up"),
]


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    with served_page(tmp_path, PAGE.parent) as address:
        yield address


@pytest.fixture
def open_page(browser: Any, address: str) -> Iterator[Any]:  # noqa: F811
    """Opens the page for a user."""
    contexts: list[Any] = []

    def open_page(user: str, size: str = "panel") -> Any:
        width, height, scheme = SIZES[size]
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.goto(address)
        page.fill("#token", TOKENS[user])
        page.click("#login")
        return page

    yield open_page
    for context in contexts:
        context.close()


def test_alarms_are_counted_and_acknowledged(open_page: Any) -> None:
    expect = playwright.expect
    viewer, page = open_page("view"), open_page("operate")
    expect(page).to_have_title("(6) SkiROS2")
    page.click("#alarms")
    dialog = page.locator("dialog[open]")
    kinds = dialog.locator(".approval .chip")
    latched = dialog.locator(".approval", has_text="world model")
    expect(latched).to_contain_text(", not acknowledged")
    unanswered = dialog.locator(".approval", has_text="nobody has approved it within 300 s")
    expect(unanswered).to_contain_text("ended without an answer")
    words = {"Job failed", "No connection", "Robot stopped", "Approval waits", "Not answered"}
    assert set(kinds.all_inner_texts()) == words
    expect(unanswered.locator("b")).to_have_text("Request of an agent")  # not its number
    failed = dialog.locator(".approval", has_text="Job failed")
    expect(failed).to_contain_text("Product-2 has slipped")
    failed.locator("[data-action=acknowledge]").click()
    expect(page).to_have_title("(5) SkiROS2")
    expect(failed).to_contain_text("acknowledged by operate")
    expect(viewer).to_have_title("(5) SkiROS2")  # of all users
    page.click("#acknowledge-all")
    expect(page).to_have_title("SkiROS2")
    expect(latched.or_(unanswered)).to_have_count(0)
    viewer.click("#alarms")
    expect(viewer.locator("dialog[open] .approval")).to_have_count(4)
    expect(viewer.locator("dialog[open] [data-action=acknowledge]:visible")).to_have_count(0)


def test_other_cells_are_listed_with_alarms_and_opened(open_page: Any) -> None:
    expect, page = playwright.expect, open_page("view")
    expect(page.locator("#cells")).to_have_text("Cells (2)")
    page.click("#cells")
    rows = page.locator("dialog[open] .job-row")
    expect(rows.nth(0)).to_contain_text("6 alarms")
    expect(rows.nth(0)).to_contain_text("1 busy, 1 protective stop")
    expect(rows.nth(1)).to_contain_text("no answer")
    with page.context.expect_page() as opened:
        rows.nth(0).click()
    expect(opened.value).to_have_title("(6) SkiROS2")


COUNT_TONES = """window.tones = 0;
const make = AudioContext.prototype.createOscillator;
AudioContext.prototype.createOscillator = function () { window.tones += 1; return make.call(this); };"""


def test_alarms_sound_until_the_sound_is_switched_off(open_page: Any) -> None:
    expect, page = playwright.expect, open_page("operate")
    page.context.add_init_script(COUNT_TONES)
    for is_on in (True, False):
        page.reload()
        page.click("#user")
        page.click("#logout")
        page.fill("#token", TOKENS["operate"])
        page.click("#login")
        expect(page).to_have_title("(6) SkiROS2")
        assert bool(page.evaluate("window.tones")) == is_on
        page.click("#alarms")
        expect(page.locator("#alarm-sound")).to_be_checked(checked=is_on)
        page.uncheck("#alarm-sound")


def test_answered_request_is_no_alarm_any_more(open_page: Any) -> None:
    page = open_page("approve")
    page.click("#approvals")
    playwright.expect(page.locator("dialog[open]")).to_contain_text("due at noon")
    page.click("dialog[open] [data-action=reject]")
    playwright.expect(page).to_have_title("(5) SkiROS2")


def test_job_is_found_and_opened(open_page: Any) -> None:
    expect = playwright.expect
    page = open_page("view")
    page.click("#all-jobs")
    rows = page.locator("dialog.jobs .job-row")
    expect(rows).to_have_count(7)
    page.select_option("#job-filter", "failed")
    expect(rows).to_have_count(1)
    page.fill("#find-job", "order-1")
    expect(page.locator("dialog.jobs [role=status]")).to_have_text("No such jobs.")
    page.fill("#find-job", "ORDER-2")
    rows.click()
    details = page.locator("dialog.job-details")
    for text in ("pick: expected a held part", "order-2", "Tray-1", "collected", "Weighing weight 0.4"):
        expect(details).to_contain_text(text)
    page.keyboard.press("Escape")
    expect(details).to_have_count(0)


def test_log_names_tasks_by_their_skills(open_page: Any) -> None:
    page = open_page("view")
    page.click("nav[data-region=centre] >> text=Log")
    playwright.expect(page.locator(".log b").first).to_have_text("▶ pick, place")


def test_two_clicks_open_one_new_job(open_page: Any) -> None:
    page = open_page("operate")
    page.wait_for_selector("#new-job")
    page.evaluate(
        "(async () => { for (const _ of [1, 2]) document.querySelector('#new-job').click();"
        " for (const _ of [1, 2]) await (await fetch('/api/work_masters')).json(); })()"
    )
    playwright.expect(page.locator("dialog.job")).to_have_count(1)


def test_figures_of_a_period_are_shown_and_saved(open_page: Any) -> None:
    expect = playwright.expect
    page = open_page("view")
    page.click("#figures")
    figures = page.locator("dialog.figures-view")
    expect(figures.locator("section", has_text="Skills").locator("tbody tr")).to_contain_text("pick")
    expect(figures.locator("section", has_text="Robots")).to_contain_text("80.0 %")  # one of five tasks has failed
    expect(figures.locator(".chart polyline")).to_have_count(1)
    page.select_option("#figures-period", "0")
    expect(figures.locator(".bars span[title$='1 succeeded, 1 failed']")).to_have_count(1)
    expect(figures.locator("section", has_text="frequent")).to_contain_text("Product-2 has slipped")
    with page.expect_download() as saved:
        page.click("[aria-label='Skills as CSV']")
    assert saved.value.path().read_text().splitlines() == ["robot,skill,runs,failures,mean_s", "/arm,pick,5,1,12.5"]


def test_queued_jobs_are_moved_by_keys_buttons_and_the_mouse(open_page: Any) -> None:
    expect, page = playwright.expect, open_page("operate")
    queue = page.locator("[data-panel=cell] .card[draggable=true] .title2")
    first, refill, clear = "place: Tray-1", "Refill the shelf", "Clear the shelf"
    expect(queue).to_have_text([first, refill, clear])
    page.locator(".card", has_text=clear).locator("[data-action=earlier]").click()
    expect(queue).to_have_text([first, clear, refill])
    page.locator(".card", has_text=refill).focus()
    page.keyboard.press("Alt+ArrowUp")
    expect(queue).to_have_text([first, refill, clear])
    page.keyboard.press("Alt+ArrowUp")  # the focus has stayed at the job
    expect(queue).to_have_text([refill, first, clear])
    page.locator(".card", has_text=clear).drag_to(
        page.locator(".card", has_text=refill), target_position={"x": 9, "y": 2}
    )
    expect(queue).to_have_text([clear, refill, first])
    expect(open_page("view").locator("[data-panel=cell] .card .buttons:visible")).to_have_count(0)


def test_refusals_of_a_new_job_are_at_their_fields(open_page: Any) -> None:
    expect, page = playwright.expect, open_page("operate")
    page.click("#new-job")
    page.click("dialog.job summary")
    page.fill("dialog.job [name=priority]", "7")
    page.fill("dialog.job [name=due]", "2030-01-01T10:00")
    page.fill("dialog.job [name=earliest_start]", "2031-01-01T10:00")
    page.evaluate("document.querySelector('[name=Tray]').replaceChildren()")
    page.click("#start-job")
    expect(page.locator("[id='problems-parameters.Tray']")).not_to_be_empty()
    expect(page.locator("[name=Tray]")).to_be_focused()
    assert page.locator("dialog.job ul.problems li").count() == 0
    page.evaluate("document.querySelector('[name=Tray]').append(new Option('Tray-1'))")
    page.select_option("[name=Tray]", "Tray-1")
    page.click("#start-job")
    expect(page.locator("#problems-due")).to_contain_text("before the earliest start")
    page.fill("dialog.job [name=due]", "2032-01-01T10:00")
    page.click("#start-job")
    expect(page.locator("dialog.job")).to_have_count(0)
    expect(page.locator("#new-job")).to_be_focused()
    jobs = page.evaluate("fetch('/api/jobs?limit=1').then((answer) => answer.json())")["jobs"]
    assert (jobs[0]["order"]["priority"], jobs[0]["order"]["due"][:4]) == (7, "2032")


def test_cameras_are_shown_alone_or_all_and_say_why_there_is_no_picture(open_page: Any) -> None:
    expect, page = playwright.expect, open_page("view")
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.click("nav[data-region=right] >> text=Cameras")
    seen, dark = page.locator(".camera", has_text="shelf"), page.locator(".camera", has_text="gripper")
    expect(seen).to_contain_text("live")
    expect(dark).to_contain_text("no node publishes /camera_2/image")
    size = "element => [element.naturalWidth, element.naturalHeight]"
    assert seen.locator("img").evaluate(size) == [640, 480]
    seen.locator("button").click()
    expect(dark).to_be_hidden()
    expect(seen.locator("button")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Enter")
    expect(dark).to_be_visible()
    page.click("nav[data-region=right] >> text=3D")
    page.wait_for_timeout(1500)
    before = sum("/cameras/" in each for each in requests)
    page.wait_for_timeout(1500)
    assert sum("/cameras/" in each for each in requests) == before > 0


def test_signals_are_those_of_the_selected_robot(open_page: Any) -> None:
    expect, page = playwright.expect, open_page("view")
    page.click("nav[data-region=centre] >> text=Signals")
    names = page.locator(".signal .name")
    expect(names).to_have_count(2)
    page.click("nav[data-region=centre] >> text=Tree")
    robot = page.locator("[data-panel=cell] .card", has_text="arm").first
    robot.click()
    expect(page.locator(".signal:visible .name")).to_have_count(1)
    expect(page.locator(".signal .value")).to_have_text("4.2 N")
    page.select_option("#signals-of", label="mobile_base")
    expect(page.locator(".signal .value")).to_have_text("81 %")
    page.select_option("#signals-of", label="All robots")
    expect(names).to_have_count(2)


def test_focus_stays_in_an_open_dialog_beside_stop_and_escape_closes_it(open_page: Any) -> None:
    page = open_page("operate")
    page.click("#new-job")
    playwright.expect(page.locator("dialog[open]")).to_have_count(1)
    for _ in range(20):
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.matches('body, #stop-all, dialog *')")
    page.keyboard.press("Escape")
    playwright.expect(page.locator("dialog[open]")).to_have_count(0)


@pytest.mark.long
@pytest.mark.skipif(not AXE.is_file(), reason="needs npm's packages: make setup")
@pytest.mark.parametrize("size", SIZES)
def test_axe_has_no_findings_in_any_view(open_page: Any, size: str) -> None:
    page = open_page("maintain", size)
    page.evaluate(AXE.read_text())
    found: list[str] = []

    def check(view: str) -> None:
        answer = page.evaluate("rules => axe.run({ runOnly: rules })", RULES)
        found.extend(f"{view}: {each['id']}: {each['nodes'][0]['html']}" for each in answer["violations"])

    page.wait_for_selector("#cells")
    for name in ("alarms", "approvals", "cells"):
        page.click(f"#{name}")
        check(name)
        page.click(f"#close-{name}")
    page.click("#figures")
    page.wait_for_selector(".figures table")
    check("figures")
    page.click("#close-figures-view")
    page.click("#all-jobs")
    check("jobs")
    page.locator("dialog.jobs .job-row", has_text="failed").click()
    check("details of a job")
    for name in ("job-details", "jobs"):
        page.click(f"#close-{name}")
    page.click("#user")
    page.wait_for_selector(".sessions li")
    check("account")
    page.click("#close-account")
    page.click("#new-job")
    check("new job")
    page.click("dialog[open] button:text-is('Cancel')")
    tabs = page.locator("nav button:visible")
    for number in range(tabs.count()):
        tabs.nth(number).click()
        check(tabs.nth(number).inner_text())
    header = page.locator("#header").bounding_box()
    for each in page.locator("#header button:visible").all():
        assert each.bounding_box()["x"] + each.bounding_box()["width"] <= header["width"], "a button is out of sight"
    assert not found
