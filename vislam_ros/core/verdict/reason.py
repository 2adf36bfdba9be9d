# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A verdict's words, and why it is not the best one."""

import enum
from collections.abc import Iterable
from typing import NamedTuple


class Word(enum.Enum):
    """Whether an estimate can be trusted, from yes to no."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    CONTRADICTION = "contradiction"


class Reason(NamedTuple):
    """Why an estimate is not to be trusted.

    Attributes
    ----------
    word : Word
        How bad it is.
    text : str
        In plain words, one line, with the figure and what to do.
    readings : tuple of str
        Other readings of extrinsics and twists that would fit, the likeliest first.
    """

    word: Word
    text: str
    readings: tuple[str, ...] = ()


class Judgement(NamedTuple):
    """A verdict.

    Attributes
    ----------
    stamp : int
        Of the last step that it knows of, nanoseconds.
    word : Word
    reasons : tuple of str
        Why it is not good, the worst first; empty where it is.
    """

    stamp: int
    word: Word
    reasons: tuple[str, ...]

    @classmethod
    def of(cls, stamp: int, reasons: Iterable[Reason]) -> "Judgement":
        """Judge by reasons: the worst counts."""
        words = list(Word)
        ordered = sorted(reasons, key=lambda reason: -words.index(reason.word))
        word = ordered[0].word if ordered else Word.GOOD
        return cls(stamp, word, tuple(reason.text for reason in ordered))

    def with_doubt(self, text: str) -> "Judgement":
        """Judge by one reason more, which makes it doubtful at least."""
        word = Word.DOUBTFUL if self.word is Word.GOOD else self.word
        return Judgement(self.stamp, word, (*self.reasons, text))
