"""What a fit costs, on a camera made by an image formation that shares no code with the fit."""

import pytest
from cases import case_of_several

from effects import pipeline
from gap.select.exchange import short_fit
from gap.select.search import SCALE_FROM_NEAR, SCALE_FROM_START, Search

HIDDEN = ["colour_balance", "jpeg_compression", "lens_blur", "tone_curve"]


@pytest.fixture(scope="module")
def coded(tmp_path_factory):
    """A camera with a coarse codec and others."""
    return case_of_several(tmp_path_factory.mktemp("coded"), HIDDEN, size="small")


def test_derivatives_are_formed_once_at_a_place(coded, monkeypatch):
    """Fails if a fit that narrows its robust loss where it stands forms them all anew: the better part of its time."""
    search, places = Search(coded), []
    form = search.solver.derivatives

    def formed(effects, free, poses, train, *given):
        places.append((pipeline.key_of(effects), tuple(free), poses.tobytes(), tuple(train)))
        return form(effects, free, poses, train, *given)

    monkeypatch.setattr(search.solver, "derivatives", formed)
    effects = [(n, coded.starts_of(n)[0]) for n in HIDDEN]
    end = short_fit(search, effects, search.problem.start_poses(), SCALE_FROM_START, 9, rough=["jpeg_compression"])
    short_fit(search, end.state.effects, end.state.poses, SCALE_FROM_NEAR, 9)
    assert len(places) == len(set(places)) > 3
