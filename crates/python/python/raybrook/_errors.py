"""Exceptions and warnings. The classes of errors are those that the command line tells apart by its exit code."""

from __future__ import annotations

import os
import sys
import warnings
from types import FrameType

_FOLDER = os.path.dirname(__file__) + os.sep


class Error(Exception):
    """What raybrook could not do. The message names the file, option or device at fault, and the remedy."""

    exit_code: int
    """The exit code that the command line has for such an error."""


class OptionError(Error, ValueError):
    """A choice has a value that cannot be used, or choices do not go together."""

    exit_code = 2


class InputError(Error, ValueError):
    """A mesh or a file cannot be used."""

    exit_code = 3


class DeviceError(Error, RuntimeError):
    """There is no such device, or it failed."""

    exit_code = 4


class OutOfMemoryError(Error, MemoryError):
    """There is not enough memory, or it may not be taken; nothing was taken."""

    exit_code = 4  # that of a picture; an input's is 3


class OutputError(Error, OSError):
    """A file could not be written."""

    exit_code = 5


class RoundingWarning(UserWarning):
    """Numbers that were given are not float32 numbers and were rounded: answers are exact for the rounded ones."""


class NoteWarning(UserWarning):
    """What a curious user should know, such as that there is no OpenCL device. Each note is given once."""


def warn(text: str, category: type[Warning]) -> None:
    """Warn whoever called the package, however deep in it this is."""
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_code.co_filename.startswith(_FOLDER):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)
