"""The one error that a user is meant to read: bad input, said in one line."""

import re

LONGEST = 2000  # characters


class InputError(Exception):
    """Something that the user brought is wrong; the message names file, row, column and value.

    Scripts print it without a traceback and end with exit status 1. It is one line that a terminal can show, whatever a file
    holds that it tells of: a line end is a blank, other unprintable characters are escaped.
    """

    def __init__(self, message=""):
        super().__init__(one_line(message))


def one_line(message):
    """Return a message as one printable line of at most LONGEST characters."""
    text = re.sub(r"\s*[\n\r]\s*", " ", str(message)).strip()
    text = "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 4]} ..."
