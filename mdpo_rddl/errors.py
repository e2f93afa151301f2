"""The one exception that a user's mistake raises."""


class InputError(Exception):
    """Bad input: a file, name, option or number that the user can correct.

    The message is one line that names what is wrong and where (the file and, where it
    is known, the line). The command line prints it and ends with status 2.
    """
