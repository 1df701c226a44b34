import pytest

from panoloc_mcl import load_config
from panoloc_mcl.robot.errors import ConfigError


def test_three_mistakes_are_all_named(faults):
    assert faults("sed: 1\nruns: 0\nlocalizer: {mode: monte_karlo}\n") == [
        "run.yaml: localizer.mode = 'monte_karlo': must be 'monte_carlo', 'kalman_orientation' or 'odometry_only'; "
        "did you mean 'monte_carlo'?",
        "run.yaml: runs = 0: must be greater than or equal to 1; raise it",
        "run.yaml: unknown key 'sed'; did you mean 'seed'?",
    ]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("datset: a", "unknown key 'datset'; did you mean 'dataset'?"),
        ("localizer: {monte_carlo: {particle: 9}}", "unknown key 'localizer.monte_carlo.particle'; did you mean 'particles'?"),
        ("kidnap: {zzz: 1}", "unknown key 'kidnap.zzz'; known keys here: every_frames"),
        ("runs: 1.5", "runs = 1.5: must be a valid integer; write a whole number"),
        ("runs: many", "runs = 'many': must be a valid integer; write a whole number"),
        ("runs: null", "runs = null: must be a valid integer; write a whole number"),
        ("runs: yes", "runs = true: must not be true or false; mind that YAML reads yes, no, on and off so"),
        ("runs: [1]", "runs = [1]: must be a valid integer; write a whole number"),
        ("seed: -1", "seed = -1: must be greater than or equal to 0; raise it"),
        ("name: a b", "name = 'a b': must match pattern '^[A-Za-z0-9][A-Za-z0-9._-]*$'; use other characters"),
        ("name: ''", "name = '': must have at least 1 character; fill it in"),
        ("dataset: on", "dataset = true: must not be true or false; mind that YAML reads yes, no, on and off so"),
        ("dataset: 3", "dataset = 3: must be a valid string; write text, in quotes if need be"),
        ("map: 3", "map = 3: must be a path; write a path"),
        ("sequences: noon_*", "sequences = 'noon_*': must be 'all' or a list; write a list: [noon_*]"),
        ("sequences: [1]", "sequences.0 = 1: must be a valid string; write text, in quotes if need be"),
        ("observation: 3", "observation = 3: must be a mapping of keys to values; write key: value lines below it ("),
        (
            "observation: {votes: {median: perhaps}}",
            "observation.votes.median = 'perhaps': must be a valid boolean; write true or",
        ),
        ("observation: {votes: {vote_width: .nan}}", "vote_width = nan: must be a finite number; write a plain number"),
        ("observation: {votes: {smoothing_px: .inf}}", "smoothing_px = inf: must be a finite number; write a plain number"),
        ("observation: {votes: {smoothing_px: -.inf}}", "smoothing_px = -inf: must be a finite number; write a plain number"),
        ("localizer: {gate: {angle_deg: 361}}", "angle_deg = 361: must be less than or equal to 360; lower it"),
        (
            "localizer: {initial: unifrom}",
            "initial = 'unifrom': must be 'uniform', 'known_heading' or 'known_pose' or a mapping",
        ),
        ("localizer: {monte_carlo: {recovery: {min_share: 0.6}}}", "min_share 0.6 is above max_share 0.5; lower it"),
        ("localizer: {monte_carlo: {recovery: {slow: 0.6}}}", "slow 0.6 must be below fast 0.5; lower it"),
        ("localizer: {monte_carlo: {particles: 9}}", "particles = 9: must be greater than or equal to 10; raise it"),
        ("localizer: {monte_carlo: {resampling: {below: 1.5}}}", "below = 1.5: must be less than or equal to 1; lower it"),
        (
            "localizer: {monte_carlo: {resampling: {scheme: systemic}}}",
            "'stratified', 'residual' or 'multinomial'; did you mean 'systematic'?",
        ),
        (
            "localizer: {monte_carlo: {adaptive: {max_particles: 400}}}",
            "min_particles 500 is above max_particles 400; lower it",
        ),
        ("localizer: {monte_carlo: {adaptive: {quantile: 1.0}}}", "quantile = 1.0: must be less than 1; lower it"),
        ("localizer: {monte_carlo: {threads: 0}}", "threads = 0: must be greater than or equal to 1; raise it"),
        (
            "localizer: {motion: {translation_noise_from_rotation: -0.1}}",
            "translation_noise_from_rotation = -0.1: must be greater than or equal to 0; raise it",
        ),
        ("localizer: {motion: {model: diferential}}", "did you mean 'differential'?"),
        ("localizer: {motion: {max_speed_m_s: 0}}", "max_speed_m_s = 0: must be greater than 0; raise it"),
        ("localizer: {kalman_orientation: {measurement_noise_deg: -1}}", "measurement_noise_deg = -1: must be greater than 0"),
        ("Seed: 1", "unknown key 'Seed'; did you mean 'seed'?"),
        ("kidnap: {every frames: 1}", "unknown key 'kidnap.every frames'; did you mean 'every_frames'?"),
        ("'': 1", "unknown key ''; known keys here: dataset, "),
        ("localizer: {initial: {x: 1, y: 2, heading_deg: x}}", "localizer.initial.heading_deg = 'x': must be a valid number"),
        ("1: 2", "key 1 is not text; write a name, or put it in quotes"),
    ],
)
def test_a_fault_names_key_value_and_remedy(faults, text, line):
    (found,) = faults(text)
    assert found.startswith("run.yaml: ")
    assert line in found


def test_a_half_written_pose_is_told_what_it_lacks_and_nothing_else(faults):
    assert faults("localizer: {initial: {x: 1, z: 2}}") == [
        "run.yaml: key 'localizer.initial.y' is missing; add it",
        "run.yaml: key 'localizer.initial.heading_deg' is missing; add it",
        "run.yaml: unknown key 'localizer.initial.z'; known keys here: heading_deg, sd_heading_deg, sd_position_m, x, y",
    ]


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("seed: 1\nseed: 2\n", "run.yaml:2:1", "key 'seed' is given twice"),
        ("kidnap:\n  every_frames: 1\n  every_frames: 1\n", "run.yaml:3:3", "key 'every_frames' is given twice"),
        ("seed: [1\n", "run.yaml:2:1", "not valid YAML"),
        ("[a]: 1\n", "run.yaml:1:1", "a key must be plain text"),
        ("a: !!python/object:os.system 1\n", "run.yaml:1:4", "not valid YAML"),
        ("- seed\n", "run.yaml", "holds a list where a mapping is needed"),
        ("seed\n", "run.yaml", "holds a str where a mapping is needed"),
    ],
)
def test_what_is_no_configuration_at_all(faults, text, where, what):
    (found,) = faults(text)
    assert found.startswith(f"{where}: ")
    assert what in found
    assert ";" in found


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "latin.yaml").write_bytes(b"name: \xe9\n")
    for path, what in (
        (tmp_path / "none.yaml", "no such file"),
        (tmp_path, "is a folder"),
        (tmp_path / "latin.yaml", "UTF-8"),
    ):
        with pytest.raises(ConfigError, match=what) as caught:
            load_config(path)
        assert str(path) in str(caught.value)


class TestWhoIsNamed:
    def test_the_option_that_set_the_value(self, faults):
        assert faults("", "runs=0") == ["--set runs=0: runs = 0: must be greater than or equal to 1; raise it"]

    def test_the_file_where_the_option_set_something_else(self, faults):
        assert faults("runs: 0\n", "seed=-1") == [
            "--set seed=-1: seed = -1: must be greater than or equal to 0; raise it",
            "run.yaml: runs = 0: must be greater than or equal to 1; raise it",
        ]

    def test_the_last_of_several(self, faults):
        (found,) = faults("runs: 0\n", "runs=-1", "runs=-2")
        assert found.startswith("--set runs=-2: runs = -2")

    def test_the_option_that_mistyped_a_key(self, faults):
        assert faults("", "localizer.mod=a") == ["--set localizer.mod=a: unknown key 'localizer.mod'; did you mean 'mode'?"]

    def test_the_option_that_gave_a_mapping(self, faults):
        (found,) = faults("", "kidnap={every_frames: -1}")
        assert found.startswith("--set kidnap={every_frames: -1}: kidnap.every_frames = -1")

    def test_the_option_that_broke_an_order(self, faults):
        (found,) = faults("", "localizer.monte_carlo.recovery.min_share=0.9")
        assert found.startswith("--set localizer.monte_carlo.recovery.min_share=0.9: ")

    def test_the_option_that_left_keys_out(self, faults):
        found = faults("localizer: {initial: uniform}", "localizer.initial.x=1")
        assert [line.split(": ")[:2] for line in found] == [
            ["--set localizer.initial.x=1", "key 'localizer.initial.y' is missing; add it"],
            ["--set localizer.initial.x=1", "key 'localizer.initial.heading_deg' is missing; add it"],
        ]


@pytest.mark.parametrize("text", ["runs", "=1", ".=1", "a..b=1", "a.=1", ""])
def test_options_of_another_form(faults, text):
    (found,) = faults("", text)
    assert found.startswith(f"--set {text}: needs the form KEY=VALUE;") or text == ""


def test_faulty_options_are_named_together(faults):
    assert faults("", "runs", "seed=[1", "name=a") == [
        "--set runs: needs the form KEY=VALUE; for instance seed=1 or localizer.mode=monte_carlo",
        "--set seed=[1: not valid YAML: expected ',' or ']', but got '<stream end>'; check brackets, colons and indentation",
    ]


@pytest.mark.parametrize("key", ["particles", "adaptive.max_particles"])
def test_more_particles_than_the_machine_can_hold(faults, write, monkeypatch, key):
    monkeypatch.setattr("panoloc_mcl.robot.settings.localizer.physical_memory", lambda: 2**30)
    (found,) = faults("", f"localizer.monte_carlo.{key}=19173962")
    assert found.endswith(
        f"localizer.monte_carlo.{key} = 19173962: must be at most 19173961, as many as fit into this machine's 1.0 GiB of memory; "
        "lower it"
    )
    load_config(write(""), [f"localizer.monte_carlo.{key}=19173961"])


def test_where_the_machine_does_not_tell_its_memory_any_count_is_taken(write, monkeypatch):
    monkeypatch.setattr("panoloc_mcl.robot.settings.localizer.physical_memory", lambda: None)
    load_config(write(""), ["localizer.monte_carlo.particles=1000000000000"])
