"""What the tool says when it cannot do what it was asked."""


class IdentifyError(Exception):
    """Something is wrong with the user's files or wishes; the message says what, where, and why."""
