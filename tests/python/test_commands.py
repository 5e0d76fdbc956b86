"""The commands of all pages, each for a second."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import commands


def test_the_commands_of_all_pages_run_as_they_stand(program):
    wrong = commands.through(Path(program), limit=1.0, part=(1, 1))
    assert not wrong, "\n".join(wrong)


def test_commands_are_found_without_comments_and_joined():
    text = "```\nvoidage run a \\\n  --set b=1   # c\nvoidage check d\n   explained\n```\n```text\nvoidage run DIR\n```\n"
    (block,) = commands.blocks("page", text)
    assert block.commands == ["voidage run a --set b=1", "voidage check d"]


def test_files_that_a_page_shows_are_there_for_its_commands():
    text = "```python\n# mine.py\nx = 1\n```\n```python\ny = 2\n```\n"
    assert commands.files(text) == {"mine.py": "# mine.py\nx = 1\n"}


def test_wrong_commands_are_found(program, tmp_path):
    environment = commands.workplace(tmp_path, Path(program))
    block = commands.Block("page", ["voidage run nowhere.toml", "voidage run settling-grain-still", "voidage run SCENE"])
    (wrong,) = commands.through_block(block, tmp_path, environment, None)
    assert wrong.startswith("voidage run nowhere.toml: exit code 2")
