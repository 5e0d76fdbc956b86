"""How much of a solver is there for the sake of the exchange: nearly nothing, the adapter speaks for it."""

import ast
import io
import tokenize
from pathlib import Path

import voidage

FOLDER = Path(voidage.__file__).parent
SOLVERS = ("dummy", "scikit_fem", "fenicsx")
SHARED = (
    "adapter",
    "solver",
    "points",
    "cells",
    "boundary",
    "body",
    "finite_elements",
    "fenicsx_linear",
)
ADAPTER = {"adapter", "_voidage"}


def code_lines(source: str) -> set[int]:
    """Numbers of the lines that are neither blank, nor comment, nor documentation."""
    quiet = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in quiet and token.type != tokenize.ENDMARKER:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines -= set(range(node.lineno, node.end_lineno + 1))
    return lines


def protocol_lines(source: str) -> set[int]:
    """Lines of statements that name the adapter or the compiled package."""
    found = set()
    for statement in ast.parse(source).body:
        names = {
            part
            for node in ast.walk(statement)
            for part in (getattr(node, "module", None), getattr(node, "name", None))
        }
        if names & ADAPTER:
            found |= set(range(statement.lineno, statement.end_lineno + 1))
    return found & code_lines(source)


def test_the_protocol_takes_few_lines_of_a_solver(capsys):
    sources = {name: (FOLDER / f"{name}.py").read_text() for name in SOLVERS + SHARED}
    with capsys.disabled():
        print("\nlines without blanks, comments and documentation")
        for name, source in sources.items():
            text = f"  {name:<16}{len(code_lines(source)):>5}"
            if name in SOLVERS:
                text += f", of them for the exchange {len(protocol_lines(source))}"
            print(text)
    for name in SOLVERS:
        assert len(protocol_lines(sources[name])) <= 150
    # The loop that all solvers share is what a solver in another language would have to write.
    assert len(code_lines(sources["adapter"])) < 400
    assert len(sources["dummy"].splitlines()) <= 25
    assert all(len(code_lines(sources[name])) <= 60 for name in ("dummy", "cells"))
