"""Tables for the terminal."""
from __future__ import annotations

import io
from collections.abc import Collection, Iterable, Sequence

WIDTH = 110             # letters; words are cut above


def text_table(headings: Sequence[str], rows: Iterable[Sequence[str]], *, text: Collection[str],
               title: str | None = None) -> str:
    """Rows under headings, as lines of a terminal; names in the first column are never cut.

    Parameters
    ----------
    headings : sequence of C str
    rows : iterable of sequences of C str
    text : collection of str
        Headings of the columns of words, which are flush left; numbers are flush right.
    title : str, optional
    """
    from rich.console import Console  # here: whoever makes no table does not wait for it
    from rich.table import Table
    table = Table(title=title, title_justify="left", title_style="bold")
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if heading in text else "right",
                         overflow="ellipsis" if number else "fold")
    for row in rows:
        table.add_row(*row)
    stream = io.StringIO()
    # names are the operator's: brackets in them are no markup
    Console(file=stream, width=WIDTH, markup=False, emoji=False, highlight=False).print(table)
    return stream.getvalue().rstrip()
