from panoloc_mcl.tools.evaluation import evaluate, metrics_table, paper_table

PLACES = [[0.0, 0.0]]


def cells(table):
    return {(section.title, row.label.strip()): row.cells for section in table.sections for row in section.rows}


def test_one_column_a_group_and_one_for_all(make_record):
    records = [make_record("cc", 0.1234, name="noon_00"), make_record("cc", 0.3, name="evening_00")]
    table = metrics_table(evaluate(records, PLACES))
    assert table.columns == ("evening", "noon", "overall")
    shown = cells(table)
    assert shown["Accuracy after convergence", "position, median"] == ("0.3000", "0.1234", "0.2117")
    assert shown["Recognition of places", "recognised/passed"] == ("2/2", "2/2", "4/4")
    assert shown["Recognition of places", "95 %, over drives"][0] == "20.7–100.0"


def test_a_single_group_needs_no_overall(make_record):
    assert metrics_table(evaluate([make_record("c")], PLACES)).columns == ("noon",)


def test_columns_by_sequence(make_record):
    records = [make_record("c"), make_record("c", name="noon_01")]
    assert metrics_table(evaluate(records, PLACES), by="sequences").columns == ("noon_00", "noon_01", "overall")


def test_sections_that_do_not_apply_are_left_out(make_record):
    titles = [section.title for section in metrics_table(evaluate([make_record("c", with_truth=False)], PLACES)).sections]
    assert titles == ["Finding itself", "Time of one image", "Data"]


def test_paper_table_has_the_lights_that_were_run(make_record):
    records = [make_record("cc", name="noon_00"), make_record("cc", name="evening_00")]
    table = paper_table(evaluate(records, PLACES))
    assert table.columns == ("paper", "here")
    shown = cells(table)
    assert shown["Noon", "recognised/passed"] == ("225/225", "2/2")
    assert shown["Evening", "recognised/passed"] == ("161/193", "2/2")
    assert shown["Evening", "rate"] == ("83.4", "100.0")
    assert shown["Evening", "95 %, over drives"][0] == "77.5–88.0"
    assert shown["Evening", "tracks lost"] == ("2", "0")
    assert ("Afternoon", "rate") not in shown


def test_no_paper_table_for_other_groups(make_record):
    assert paper_table(evaluate([make_record("c", name="office_0")], PLACES)) is None
