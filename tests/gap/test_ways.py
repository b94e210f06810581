"""Which first steps are tried, one after the other."""

from types import SimpleNamespace

import pytest

from gap import select_effects


@pytest.mark.parametrize(("is_of_signs", "tried"), [(True, [None]), (False, [None, "defocus", "motion_blur"])])
def test_a_boards_cells_are_searched_again_only_where_nothing_explains_them(monkeypatch, is_of_signs, tried):
    """Fails if photographs, whose signs seldom reach their floors, cost another way beside a verdict that explains them, or if
    a rig's way that closes most and does not reach its floor is the only one.
    """
    ways = []

    def path(selection, base, first, before, start_with=None):
        ways.append(start_with)
        return SimpleNamespace(verdict="explained", is_closed=False, share_left=0.1)

    monkeypatch.setattr(select_effects, "path", path)
    monkeypatch.setattr(select_effects, "is_missing_from", lambda *_: True)
    monkeypatch.setattr(select_effects, "rank", list)
    search = SimpleNamespace(problem=SimpleNamespace(is_of_signs=is_of_signs))
    first = [SimpleNamespace(effect=n, main_group="edges") for n in ("lens_blur", "defocus", "motion_blur")]
    selection = SimpleNamespace(search=search, is_spent=lambda: False)
    select_effects._one_by_one(selection, None, first, {}, None)
    assert ways == tried
