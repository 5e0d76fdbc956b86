"""The campaign of kills, stops, corrupted files and wrong scenes in its quick form."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import campaign


def test_nothing_is_lost_and_nothing_is_silent(program):
    rows, wrong = campaign.campaign(Path(program), count=3, seed=5)
    assert not wrong, "\n".join(wrong)
    assert len(rows) == 16 and all(tried == good == 3 for _, tried, good in rows)


def test_the_campaign_finds_a_program_that_loses_results(tmp_path):
    # Says that all is done, and leaves an empty series.
    liar = tmp_path / "liar"
    liar.write_text(
        "#!/bin/sh\n"
        'while [ "$1" != --out ]; do shift; done\n'
        'mkdir -p "$2"; cd "$2"; touch averages.csv grains.pvd\n'
        'date +%N >series.csv; date >checkpoint.voidage\n'
    )
    liar.chmod(0o755)
    rows, wrong = campaign.campaign(liar, count=1, seed=5)
    good = {what.split(" ")[0]: good for what, _, good in rows}
    assert wrong and good["kill"] == 0 and good["Of"] == 0
