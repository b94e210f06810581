"""Real photographs of boards, and the one line with which they are refused."""

import pytest

from inputs.campaign import load_campaign
from inputs.images import read_image
from register import boards
from register.board_checks import check_photographs, only_fitting
from rig.errors import InputError
from workflow_runs import PROJECT

EMBEDDED = PROJECT / "data/raw/aruco6x6_gridboard"


def embedded():
    """Return the embedded photographs' folder."""
    if not EMBEDDED.is_dir():
        pytest.skip("needs the embedded photographs: run `make data`")
    return EMBEDDED


def photographs(folder, count):
    """Return ({name: image}, CalibrationBoard) of the first photographs of a campaign."""
    campaign = load_campaign(folder)
    rows = campaign.captures.iloc[:count]
    return {c.capture: read_image(folder / c.image) for c in rows.itertuples()}, campaign.file.target


def refused(images, board):
    """Return the one line with which photographs are refused."""
    found = only_fitting({name: boards.find_board(image, board) for name, image in images.items()}, board, [])
    with pytest.raises(InputError) as caught:
        check_photographs(found, board, images.get, "here")
    message = str(caught.value)
    assert message.startswith("here: ") and "\n" not in message
    return message
