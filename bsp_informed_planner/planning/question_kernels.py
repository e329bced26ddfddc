"""How kernels stop: with what they need, or with edges that only the exact check can decide on."""

from __future__ import annotations

from typing import NamedTuple

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices

# Why a kernel returned. All but FOUND and SPENT mean: call it again, after what is said.
WORKED = 0  # the share of work of this call is done: look at clock and caller
FOUND = 1  # a path, or a better one
EMPTY = 2  # draw another batch of samples
FULL = 3  # enlarge the tree
ASKED = 4  # answer the questions
SPENT = 5  # all samples are drawn

# Which undecided edges are asked about; the others count as blocked.
ASK_NONE = 0
ASK_UNSURE = 1  # those that leave a node which is undecided itself
ASK_ALL = 2

#: Most questions at a time.
QUESTIONS = 4


# Columns of Questions.table.
TREE, TAIL, UNSURE = 0, 1, 2


class Questions(NamedTuple):
    """Edges that would become nodes, were they known to be free.

    Attributes:
        table: (QUESTIONS, 3) from which tree and node, and whether the bounds leave the head open too.
        heads: (QUESTIONS, n) to where.
        asked: (1,) how many there are.
    """

    table: Indices
    heads: Floats
    asked: Indices


@kernel
def push_question(questions: Questions, tree: int, tail: int, head: Floats, unsure: bool) -> None:
    """Adds a question; the caller makes sure that there is room."""
    index = questions.asked[0]
    questions.asked[0] = index + 1
    questions.table[index, TREE] = tree
    questions.table[index, TAIL] = tail
    questions.table[index, UNSURE] = 1 if unsure else 0
    for i in range(head.shape[0]):
        questions.heads[index, i] = head[i]
