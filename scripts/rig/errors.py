"""The one error that a user is meant to read: bad input, said in one line."""


class InputError(Exception):
    """Something that the user brought is wrong; the message names file, row, column and value.

    Scripts print it without a traceback and end with exit status 1.
    """
