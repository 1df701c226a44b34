import pytest

from panoloc_mcl.laboratory.studies.light import study

pytest.importorskip("mitsuba", reason="the extra simulate is not installed")


@pytest.mark.slow
def test_every_light_of_a_scene_is_measured_and_the_papers_stand_beside_those_that_it_has():
    of_hall = {row[0]: row[3] for row in study("hall", samples=4).tables[0].rows}
    assert "/ 335 (" in of_hall["noon"]
    assert "/" not in of_hall["lamps"]
    of_office = study("office", samples=4)
    dark = {"dark", "dark_5lux", "dark_10lux", "dark_20lux"}
    assert {row[0] for row in of_office.tables[0].rows} == {"cloudy", "sunny", "night"} | dark
    assert "none of its lights" in of_office.markdown()
