"""The page `report.html`: what it holds, alone and in a browser."""

import json
import re
import shutil
import subprocess
import warnings
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.run_pages import SUMMARY, write_run

from mdpo_rddl.problem.trajectories import Fluent, Trajectories
from mdpo_rddl.session.report.page.panels import Series, draw_panels, quantiles
from mdpo_rddl.session.report.page.record import read_run
from mdpo_rddl.session.report.page.results import compared, result_rows, returns_of
from mdpo_rddl.session.report.page.write import write_comparison, write_page


class Page(HTMLParser):
    """What its pictures show, addresses and text of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.images, self.addresses, self.opened, self.text = [], [], [], ""
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.opened.append(tag)
        self.addresses += [attributes[name] for name in ("src", "href") if name in attributes]
        if tag == "img" or attributes.get("role") == "img":
            self.images.append(attributes.get("alt") or attributes["aria-label"])

    def handle_data(self, data):
        self.text += f" {data}"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = write_run(tmp_path_factory.mktemp("page") / "run")
    return Page(write_page(folder))


def test_everything_is_in_the_file(page):
    assert len(page.source) < 5_000_000
    assert all(address.startswith("data:") for address in page.addresses)
    assert not re.search(r"https?://|url\(|@import", page.source)
    assert "script" not in page.opened
    # results, returns of the policy, five panels, decision times
    assert len(page.images) == 8
    assert all(page.images)


def test_the_figures_are_those_of_the_run(page):
    text = " ".join(page.text.split())
    for said in (
        "two <tanks>",
        "3.00 mean return of 3 episodes",
        "0.5 no-op, the first 2",
        "4 proposals were illegal; 1 of them",
        "too little time & space",
        "mdpo-plan tanks.rddl two.rddl",
        "[Noise] sigma 0.5",
        "the 2 that change most of 40",
        "state mood",
        "99th percentile",
        "open(?t) is true if 0 <",
        "+ 2 (level - 1) 1.5 -12.50 0.25",
        "+ 3 0.5 not measured",
        "1 smaller terms",
    ):
        assert said in text, said
    # the second tank moves more
    levels = [text.split()[0] for text in page.images if text.startswith("level")]
    assert levels == ["level(t2)", "level(t1)"]


def test_differences_are_of_the_same_episodes(tmp_path):
    first, noop = (row.returns for row in result_rows(read_run(write_run(tmp_path / "run"))))
    row = compared(first, noop)
    assert row.difference == 2.0
    assert row.difference_interval == (2.0, 2.0)
    assert row.shared == 2
    assert not row.is_worse
    worse = compared(noop, returns_of("more", "k", {"returns": [5.0, 6.5]}))
    assert worse.difference == pytest.approx(-5.25)
    # the quantile of Student's law with one degree of freedom is 12.706
    assert worse.difference_interval == pytest.approx([-5.25 - 3.1765, -5.25 + 3.1765], abs=1e-3)
    assert worse.is_worse


def test_an_earlier_run_has_the_page_without_what_it_lacks(tmp_path):
    folder = write_run(tmp_path / "run")
    (folder / "trajectories.npz").unlink()
    (folder / "config.json").unlink()
    later = ("rule", "references", "warnings", "command", "versions", "auto")
    summary = {key: value for key, value in SUMMARY.items() if key not in later}
    (folder / "summary.json").write_text(json.dumps(summary))
    text = " ".join(Page(write_page(folder, tmp_path / "new" / "page.html")).text.split())
    assert "None were recorded in this run." in text
    assert "Neither the no-op nor random actions were played ." not in text
    assert "Neither the no-op nor random actions were played." in text
    assert not (folder / "report.html").exists()


def test_a_race_whose_parents_were_not_kept_is_shown_without_them(tmp_path):
    race = {key: value for key, value in SUMMARY["auto"].items() if key != "parents"}
    text = Page(write_page(write_run(tmp_path / "run", auto=race))).text
    assert "The result is the candidate  rule ." in text


def test_of_long_names_a_picture_has_the_beginning_and_its_description_all():
    names = tuple("t" * 100 + end for end in "12")
    fluent = Fluent("state", "level", "real", names, 2)
    values = {("state", "level"): np.zeros((1, 3, 2))}
    play = Trajectories((fluent,), np.arange(3), values, np.zeros((1, 3)))
    one, other = draw_panels([Series("policy", "#000000", False, play)])[0].panels
    assert names[0] in one.text
    assert names[1] in other.text
    assert one.markup.replace(names[0], names[1]) == other.markup
    assert one.markup.count(names[0]) == 1


def test_a_run_of_an_earlier_version_is_shown_without_what_has_gone(tmp_path):
    earlier = {"bound": {"gain": 4.0}, "estimate": None, "note": "the time is over"}
    text = Page(write_page(write_run(tmp_path / "a", hindsight=earlier))).text
    assert SUMMARY["label"] in text
    assert "the time is over" not in text


def test_quantiles_are_of_the_episodes_that_have_reached_a_step():
    values = np.array([[0.0, 2.0, np.nan], [10.0, np.nan, np.nan]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = quantiles(values)
    np.testing.assert_allclose(found[:, 0], [1.0, 5.0, 9.0])
    np.testing.assert_allclose(found[:, 1], [2.0, 2.0, 2.0])
    assert np.isnan(found[:, 2]).all()


def test_returns_that_are_not_finite(tmp_path):
    folder = write_run(tmp_path / "run", returns=[None, 1.0, 2.0], mean_return=None, ci95=[None, 1])
    assert "not finite" in Page(write_page(folder)).text


def test_returns_that_are_all_the_same_have_no_distribution(tmp_path):
    page = Page(write_page(write_run(tmp_path / "run", returns=[3.0, 3.0, 3.0])))
    assert len(page.images) == 7
    assert not [text for text in page.images if "distribution of the returns" in text]


def test_several_runs_on_one_page(tmp_path):
    a, b = write_run(tmp_path / "a"), write_run(tmp_path / "b", returns=[1.0, 2.0, 3.0])
    c = write_run(tmp_path / "c", label="other", instance="other")
    page = Page(write_comparison([a, b, c], tmp_path / "page.html"))
    rows = [line for line in page.text.split("95% interval")[2].splitlines() if line.strip()]
    text = " ".join(" ".join(rows).split())
    assert "b 2.00 [0.5, 5.50] 1.00 [1.00, 1.00]" in text
    # returns and searches of two problems, and the panels of the first one
    assert len(page.images) == 4 + 5
    assert page.images[-1].endswith(": a, b")
    said = one_line(lambda: write_comparison([a, a], tmp_path / "page.html"))
    assert "compared with itself" in said


def test_a_run_stopped_before_its_first_decision_has_no_decision_times(tmp_path):
    folder = write_run(tmp_path / "run")
    (folder / "trajectories.npz").unlink()
    (folder / "decisions.csv").write_text("step,seconds\n")
    assert read_run(folder).decision_seconds is None


def browser() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if shutil.which(name):
            return name
    pytest.skip("no Chromium on this machine")


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_shows_every_picture_and_complains_of_nothing(page, tmp_path, width):
    check = """<script>addEventListener("load", () => {
      const images = [...document.querySelectorAll("img, svg")];
      const shown = images.filter((image) => image.getBoundingClientRect().height > 50);
      const wide = document.documentElement.scrollWidth - innerWidth;
      document.title = `shown ${shown.length} of ${images.length}, ${wide} too wide`;
    })</script>"""
    path = tmp_path / "page.html"
    path.write_text(page.source.replace("</body>", check + "</body>"), encoding="utf-8")
    command = [browser(), "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    command += [f"--user-data-dir={tmp_path / 'browser'}", f"--window-size={width},900"]
    done = subprocess.run(
        [*command, "--dump-dom", path.as_uri()],
        capture_output=True,
        text=True,
        check=True,
        timeout=90,
    )
    assert "CONSOLE" not in done.stderr
    title = re.search(r"<title>shown (\d+) of (\d+), (-?\d+) too wide", done.stdout)
    assert title, done.stdout[:500]
    assert int(title[1]) == int(title[2]) == len(page.images)
    assert int(title[3]) <= 0
