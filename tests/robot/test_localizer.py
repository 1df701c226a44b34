import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import ConfigError, OutputError, StateError
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VoteField, VotesModel
from panoloc_mcl.robot.observation.tracking import Expected
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.localizer import InitialPose, LocalizerSettings
from panoloc_mcl.robot.synthesis.refinement import PoseRefiner
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_image

MODES = ["monte_carlo", "kalman_orientation"]


class Drive:
    """Frames, odometry and truth of the small room's drive."""

    def __init__(self, dataset: Dataset) -> None:
        sequence = dataset.sequences["noon_00"]
        self.times = sequence.times
        self.images = [read_image(file) for file in sequence.files]
        self.odometry = list(zip(sequence.odometry.times, sequence.odometry.poses, strict=True))
        self.truth = sequence.groundtruth.poses
        self.start = tuple(self.truth[0])

    def play(self, localizer: Localizer) -> list[Estimate | None]:
        for time, pose in self.odometry:
            localizer.add_odometry(time, pose)
        return [localizer.add_image(time, image) for time, image in zip(self.times, self.images, strict=True)]


@pytest.fixture(scope="module")
def drive(small_room: Dataset) -> Drive:
    return Drive(small_room)


def config(mode: str = "monte_carlo", **localizer) -> RunConfig:
    return RunConfig(localizer=LocalizerSettings(mode=mode, **localizer))


@pytest.fixture(params=MODES)
def localizer(request, panorama_map: PanoramaMap, drive: Drive) -> Localizer:
    return Localizer(panorama_map, config(request.param, initial="known_pose"), start_pose=drive.start)


def same(one: Estimate | None, other: Estimate | None) -> bool:
    assert one is not None
    assert other is not None
    arrays = ((e.pose, e.covariance, e.vote_field.votes) for e in (one, other))
    return all(np.array_equal(a, b) for a, b in zip(*arrays, strict=True)) and one.status == other.status


def asked(localizer: Localizer) -> Estimate:
    """What it believes now: an image whose stamp is no time is left out, and the estimate stays."""
    estimate = localizer.add_image(math.nan, np.zeros((1, 1), np.uint8))
    assert estimate is not None
    return estimate


def test_it_finds_itself_and_follows_the_drive(panorama_map: PanoramaMap, drive: Drive) -> None:
    estimates = drive.play(Localizer(panorama_map, config()))
    errors = [np.hypot(*(e.pose[:2] - true[:2])) for e, true in zip(estimates, drive.truth, strict=True)]
    turns = [abs(float(angle_difference(e.pose[2], true[2]))) for e, true in zip(estimates, drive.truth, strict=True)]
    # Small pictures and references a metre apart: half a spacing, and two columns of four degrees.
    assert np.median(errors[3:]) < 0.5
    assert np.median(np.degrees(turns[3:])) < 8.0
    assert estimates[-1].status is Status.CONVERGED


def test_both_modes_answer_alike(localizer: Localizer, drive: Drive) -> None:
    for time, estimate in zip(drive.times, drive.play(localizer), strict=True):
        assert isinstance(estimate, Estimate)
        assert estimate.timestamp == time
        assert estimate.pose.shape == (3,)
        assert estimate.covariance.shape == (3, 3)
        assert np.isfinite(estimate.covariance).all()
        assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-12
        assert np.array_equal(estimate.pose, estimate.clusters[0].pose)
        assert estimate.status in list(Status)
        assert 0 <= estimate.best_place < 12
        assert 0.0 <= estimate.best_place_votes <= 1.0
        assert estimate.message == ""
        assert list(estimate.stage_ms) == ["predict", "observe", "update", "estimate"]
        assert estimate.vote_field.informative


@pytest.mark.slow
def test_standing_still_it_becomes_no_surer_than_one_look(panorama_map: PanoramaMap, drive: Drive) -> None:
    """What the map errs by at a place all images there have in common; only their noise averages out."""
    rng, frame = np.random.default_rng(1), 5
    localizer = Localizer(panorama_map, config())
    spreads, errors = [], []
    for number in range(60):
        localizer.add_odometry(float(number), (0.3, -0.2, 0.1))
        noisy = drive.images[frame] + rng.normal(0.0, 3.0, drive.images[frame].shape)
        estimate = localizer.add_image(float(number), np.clip(noisy, 0, 255).astype(np.uint8))
        assert estimate is not None
        spreads.append(float(np.sqrt(np.linalg.eigvalsh(estimate.covariance[:2, :2])[-1])))
        errors.append(float(np.hypot(*(estimate.pose[:2] - drive.truth[frame][:2]))))
    assert estimate.status is Status.CONVERGED
    assert spreads[-1] > 0.7 * spreads[2]
    assert np.max(errors[2:]) < 3.0 * spreads[-1]


@pytest.mark.parametrize("mode", MODES)
def test_the_same_seed_gives_the_same_bits(mode: str, panorama_map: PanoramaMap, drive: Drive) -> None:
    def run(seed: int) -> list[Estimate | None]:
        return drive.play(Localizer(panorama_map, config(mode, initial="known_heading"), start_pose=drive.start, seed=seed))

    one, again, other = run(0), run(0), run(1)
    assert all(same(a, b) for a, b in zip(one, again, strict=True))
    assert not all(np.array_equal(a.pose, b.pose) for a, b in zip(one, other, strict=True))


def test_more_threads_give_the_same_bits(panorama_map: PanoramaMap, drive: Drive) -> None:
    runs = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            runs.append(drive.play(Localizer(panorama_map, config())))
    assert all(same(a, b) for a, b in zip(*runs, strict=True))


def bad_images(good: np.ndarray) -> dict[str, tuple[object, str]]:
    return {
        "too small": (good[:-1], "90 x 35"),
        "turned on its side": (good.T, "36 x 90"),
        "float": (good.astype(np.float32), "float32"),
        "five channels": (np.repeat(good[:, :, None], 5, axis=2), "shape"),
        "nothing": (None, "NoneType"),
        "list": ([[1, 2], [3, 4]], "list"),
        "empty": (np.zeros((0, 0), np.uint8), "0 x 0"),
        "black": (np.zeros_like(good), "black"),
        "saturated": (np.full_like(good, 255), "saturated"),
        "constant": (np.full_like(good, 77), "texture"),
    }


@pytest.mark.parametrize("kind", list(bad_images(np.zeros((36, 90), np.uint8))))
def test_a_bad_image_is_skipped_and_told(kind: str, localizer: Localizer, drive: Drive) -> None:
    for time, pose in drive.odometry:
        localizer.add_odometry(time, pose)
    localizer.add_image(drive.times[0], drive.images[0])
    image, words = bad_images(drive.images[1])[kind]
    estimate = localizer.add_image(drive.times[1], cast("np.ndarray", image))  # some are none: that is the fault
    assert words in estimate.message
    assert "\n" not in estimate.message
    assert localizer.images_skipped == 1
    # Odometry still brings the belief to the image's time.
    assert estimate.timestamp == drive.times[1]
    assert np.isfinite(estimate.pose).all()
    assert math.isnan(estimate.best_place_votes)
    after = localizer.add_image(drive.times[2], drive.images[2])
    assert after.message == ""
    assert after.vote_field.informative
    assert localizer.images_skipped == 1


@pytest.mark.parametrize(
    ("stamp", "words"),
    [(math.nan, "not finite"), (math.inf, "not finite"), ("same", "twice"), ("ancient", "late")],
)
def test_a_bad_time_stamp_is_skipped_and_told(stamp: Any, words: str, localizer: Localizer, drive: Drive) -> None:
    for time, pose in drive.odometry:
        localizer.add_odometry(time, pose)
    before = localizer.add_image(drive.times[2], drive.images[2])
    time = {"same": drive.times[2], "ancient": drive.times[2] - 1000.0}.get(stamp, stamp)
    estimate = localizer.add_image(time, drive.images[3])
    assert words in estimate.message
    assert estimate.timestamp == drive.times[2]
    assert np.array_equal(estimate.pose, before.pose)
    assert estimate.vote_field is None
    assert localizer.images_skipped == 1


def test_a_first_image_without_a_time_gives_the_start(localizer: Localizer, drive: Drive) -> None:
    estimate = localizer.add_image(math.nan, drive.images[0])
    assert math.isnan(estimate.timestamp)
    assert np.isfinite(estimate.pose).all()
    assert localizer.add_image(drive.times[0], drive.images[0]).message == ""


def test_bad_odometry_is_counted_and_told_once(localizer: Localizer, drive: Drive) -> None:
    localizer.add_image(drive.times[0], drive.images[0])
    localizer.add_odometry(1000.2, [0.0, math.nan, 0.0])
    localizer.add_odometry(1000.3, (0.0, 0.0, 0.0))
    localizer.add_odometry(1000.3, (5.0, 0.0, 0.0))
    localizer.add_odometry(math.nan, (0.0, 0.0, 0.0))
    message = localizer.add_image(drive.times[1], drive.images[1]).message
    assert "2 odometry measurements left out (not finite)" in message
    assert "1 odometry measurement left out (duplicated time stamp)" in message
    assert localizer.add_image(drive.times[2], drive.images[2]).message == ""


def test_colour_and_sixteen_bits_are_the_same_picture(panorama_map: PanoramaMap, drive: Drive) -> None:
    grey = drive.images[0]
    votes = [
        Localizer(panorama_map, config()).add_image(1.0, image).vote_field.votes
        for image in (grey, np.repeat(grey[:, :, None], 3, axis=2), grey.astype(np.uint16) * 257)
    ]
    assert np.array_equal(votes[0], votes[1])
    assert votes[0] == pytest.approx(votes[2], abs=1e-4)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("initial", ["known_heading", "known_pose"])
def test_a_start_that_must_be_known_and_is_not_is_one_line(mode: str, initial: str, panorama_map: PanoramaMap) -> None:
    with pytest.raises(ConfigError, match=rf"localizer\.initial = {initial}") as caught:
        Localizer(panorama_map, config(mode, initial=initial))
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize("mode", MODES)
def test_a_known_start_is_where_it_begins(mode: str, panorama_map: PanoramaMap, drive: Drive) -> None:
    heading = Localizer(panorama_map, config(mode, initial="known_heading"), start_pose=(1.0, 2.0, 0.7))
    assert heading.add_image(math.nan, drive.images[0]).pose[2] == pytest.approx(0.7, abs=0.05)
    initial = InitialPose(x=1.0, y=2.0, heading_deg=90.0, sd_position_m=0.05, sd_heading_deg=1.0)
    given = Localizer(panorama_map, config(mode, initial=initial)).add_image(math.nan, drive.images[0])
    assert given.pose == pytest.approx([1.0, 2.0, np.pi / 2], abs=0.05)


def test_the_gate_opens_by_way_or_turn(panorama_map: PanoramaMap, drive: Drive) -> None:
    gated = config(gate={"distance_m": 0.5, "angle_deg": 20.0})
    localizer = Localizer(panorama_map, gated)
    stands = np.array([1.0, 1.0, 0.3])
    for step in range(100):
        at = 0.1 * step
        # Stands for 3 s, drives 0.8 m by 5 s, stands, turns by 0.5 rad after 7 s.
        pose = stands + np.array([0.4 * np.clip(at - 3.0, 0.0, 2.0), 0.0, 0.5 * np.clip(at - 7.0, 0.0, 1.0)])
        localizer.add_odometry(at, pose)
    answers = {at: localizer.add_image(at, drive.images[0]) for at in (0.0, 1.0, 2.9, 3.5, 4.5, 5.0, 6.9, 7.5, 7.9, 9.0)}
    opened = [at for at, answer in answers.items() if answer is not None]
    assert opened == [0.0, 4.5, 7.9]


def test_a_forced_update_opens_the_gate_once(panorama_map: PanoramaMap, drive: Drive, tmp_path) -> None:
    localizer = Localizer(panorama_map, config(gate={"distance_m": 0.5}))
    for step in range(60):
        localizer.add_odometry(0.1 * step, (1.0, 1.0, 0.3))
    assert localizer.add_image(1.0, drive.images[0]) is not None
    assert localizer.add_image(2.0, drive.images[0]) is None
    localizer.force_update()
    localizer.save_state(tmp_path / "state.npz")
    restored = Localizer(panorama_map, config(gate={"distance_m": 0.5}))
    restored.load_state(tmp_path / "state.npz")
    for one in (localizer, restored):
        assert one.add_image(3.0, drive.images[0]) is not None
        assert one.add_image(4.0, drive.images[0]) is None


def test_the_gate_never_keeps_a_blind_robot_waiting(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map, config(gate={"distance_m": 0.5}))
    assert all(localizer.add_image(float(k), drive.images[0]) is not None for k in range(3))


def test_a_late_image_counts_though_the_gate_is_on(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map, config(gate={"distance_m": 0.3}))
    for step in range(60):
        localizer.add_odometry(0.1 * step, (0.1 * step, 0.0, 0.0))
    assert localizer.add_image(4.0, drive.images[4]) is not None
    assert localizer.add_image(3.9, drive.images[3]) is None
    assert localizer.add_image(2.0, drive.images[2]) is not None


@pytest.mark.parametrize("mode", MODES)
def test_late_odometry_and_images_end_where_ordered_ones_do(mode: str, panorama_map: PanoramaMap, drive: Drive) -> None:
    chosen = config(mode, initial="known_pose")
    ordered = Localizer(panorama_map, chosen, start_pose=drive.start)
    shuffled = Localizer(panorama_map, chosen, start_pose=drive.start)
    final = drive.play(ordered)[-1]
    for index in np.random.default_rng(0).permutation(len(drive.odometry)):
        shuffled.add_odometry(*drive.odometry[index])
    order = [0, 1, 3, 2, 4, 6, 5, 7, 8, 10, 9, 11]
    newest = -math.inf
    for index in order:
        estimate = shuffled.add_image(drive.times[index], drive.images[index])
        newest = max(newest, drive.times[index])
        assert estimate.timestamp == newest
        assert estimate.message == ""
    # Another order draws other random numbers; the beliefs agree within their spread.
    sd = np.sqrt(np.diag(final.covariance)) + np.sqrt(np.diag(estimate.covariance))
    off = np.abs([*(final.pose[:2] - estimate.pose[:2]), float(angle_difference(final.pose[2], estimate.pose[2]))])
    assert np.all(off < 2.0 * sd + [0.05, 0.05, 0.02])


def test_the_order_of_odometry_alone_changes_no_bit(panorama_map: PanoramaMap, drive: Drive) -> None:
    one, other = Localizer(panorama_map, config()), Localizer(panorama_map, config())
    for index in np.random.default_rng(1).permutation(len(drive.odometry)):
        other.add_odometry(*drive.odometry[index])
    backwards = [other.add_image(time, image) for time, image in zip(drive.times, drive.images, strict=True)]
    assert all(same(a, b) for a, b in zip(drive.play(one), backwards, strict=True))


def test_without_odometry_it_still_answers(localizer: Localizer, drive: Drive) -> None:
    for time, image in zip(drive.times, drive.images, strict=True):
        estimate = localizer.add_image(time, image)
        assert np.isfinite(estimate.pose).all()
        assert estimate.message == ""


def test_without_odometry_a_fast_robot_is_asked_for_its_speed(panorama_map: PanoramaMap, drive: Drive) -> None:
    # Every image's own word counts here, however doubtful in pictures as small as these.
    sure = {"status": {"converged_confidence": 0.0}, "motion": {"image_only_speed_m_s": 0.01}}
    localizer = Localizer(panorama_map, RunConfig.model_validate({"localizer": sure}))
    times = (drive.times - drive.times[0]) * 0.1
    told = [localizer.add_image(time, image) for time, image in zip(times, drive.images, strict=True)]
    assert any(Reason.FASTER_THAN_BELIEVED in e.reasons and "image_only_speed_m_s" in e.message for e in told)
    with_odometry = drive.play(Localizer(panorama_map, RunConfig.model_validate({"localizer": sure})))
    assert not any(Reason.FASTER_THAN_BELIEVED in e.reasons for e in with_odometry)


def test_one_model_serves_several_localizers(panorama_map: PanoramaMap, drive: Drive) -> None:
    model = panorama_map.observation_model()
    shared = [drive.play(Localizer(panorama_map, config(), model=model)) for _ in range(2)]
    alone = drive.play(Localizer(panorama_map, config()))
    for estimates in shared:
        assert all(same(a, b) for a, b in zip(estimates, alone, strict=True))


def test_a_late_image_counts_once(localizer: Localizer, drive: Drive) -> None:
    for time, pose in drive.odometry:
        localizer.add_odometry(time, pose)
    for index in (0, 1, 3, 2):
        assert localizer.add_image(drive.times[index], drive.images[index]).message == ""
    before = asked(localizer)
    for index in (2, 0, 1, 3):
        again = localizer.add_image(drive.times[index], drive.images[index])
        assert "came twice" in again.message
        assert np.array_equal(again.pose, before.pose)
    assert localizer.images_skipped == 5


@pytest.mark.parametrize("ahead", [60.0, 1e9])
def test_one_image_stamped_far_ahead_harms_nothing(ahead: float, localizer: Localizer, drive: Drive) -> None:
    for time, pose in drive.odometry:
        localizer.add_odometry(time, pose)
    localizer.add_image(drive.times[0], drive.images[0])
    wrong = localizer.add_image(drive.times[1] + ahead, drive.images[1])
    assert "ahead" in wrong.message
    assert wrong.timestamp == drive.times[0]
    assert wrong.vote_field is None
    for index in (2, 3, 4):
        estimate = localizer.add_image(drive.times[index], drive.images[index])
        assert estimate.message == ""
        assert estimate.timestamp == drive.times[index]
    assert localizer.images_skipped == 1


@pytest.mark.parametrize("shift", [1e6, -1e6, 50.0])
@pytest.mark.parametrize("odometry_follows", [True, False])
def test_a_clock_that_jumps_is_followed_and_told(
    shift: float, odometry_follows: bool, panorama_map: PanoramaMap, drive: Drive
) -> None:
    localizer = Localizer(panorama_map, config(initial="known_pose"), start_pose=drive.start)
    messages, errors = [], []
    for index, (time, image) in enumerate(zip(drive.times, drive.images, strict=True)):
        jumped = shift if index >= 5 else 0.0
        before = -math.inf if index == 0 else drive.times[index - 1]
        for stamp, pose in drive.odometry:
            if before < stamp <= time:
                localizer.add_odometry(stamp + (jumped if odometry_follows else 0.0), pose)
        estimate = localizer.add_image(time + jumped, image)
        messages.append(estimate.message)
        errors.append(np.hypot(*(estimate.pose[:2] - drive.truth[index][:2])))
        assert np.isfinite(estimate.pose).all()
    if odometry_follows:
        assert "odometry: its clock jumped" in messages[5]
    # Ahead of all that went before, an image is believed at once if odometry has come that far.
    if odometry_follows and shift > 0.0:
        assert localizer.images_skipped == 0
    else:
        assert "image skipped" in messages[5]
        assert "image stamps jumped by" in messages[6]
        assert localizer.images_skipped == 1
    assert not any("image" in message for message in [*messages[:5], *messages[7:]])
    assert estimate.timestamp == drive.times[-1] + shift
    assert errors[-1] < 0.6


def test_jumping_odometry_is_named_and_the_filter_goes_on(panorama_map: PanoramaMap, drive: Drive) -> None:
    limited = config(initial="known_pose", motion={"max_speed_m_s": 2.0, "max_turn_rate_deg_s": 180.0})
    localizer = Localizer(panorama_map, limited, start_pose=drive.start)
    for index, (time, pose) in enumerate(drive.odometry):
        localizer.add_odometry(time, pose + np.array([30.0, 0.0, 0.0]) if index == 3 else pose)
    messages = [localizer.add_image(time, image).message for time, image in zip(drive.times, drive.images, strict=True)]
    assert "1 odometry measurement left out (a jump beyond what the robot can do)" in messages[0]
    assert not any(messages[1:])


def files_of(folder) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("cut", [0, 1, 6])
def test_resumed_from_a_saved_state_it_ends_to_the_bit_where_an_uninterrupted_run_does(
    mode: str, cut: int, panorama_map: PanoramaMap, drive: Drive, tmp_path
) -> None:
    # Late images, bad odometry and an image without a time among the rest, so that all that is remembered counts.
    events: list[tuple] = [("odometry", time, pose) for time, pose in drive.odometry]
    events += [("image", time + 0.05 + (0.8 if index == 4 else 0.0), index) for index, time in enumerate(drive.times)]
    events.sort(key=lambda event: event[1])
    chosen = config(mode, initial="known_pose", monte_carlo={"particles": 300})

    def play(localizer: Localizer, part: list[tuple]) -> list[Estimate | None]:
        answers = []
        for kind, time, what in part:
            if kind == "odometry":
                localizer.add_odometry(time, what)
                localizer.add_odometry(math.nan, what)
            else:
                answers.append(localizer.add_image(drive.times[what], drive.images[what]))
        return answers

    pieces = [index for index, event in enumerate(events) if event[0] == "image"]
    split = pieces[cut] + 2
    whole = Localizer(panorama_map, chosen, start_pose=drive.start)
    expected = play(whole, events)
    first = Localizer(panorama_map, chosen, start_pose=drive.start)
    play(first, events[:split])
    first.save_state(tmp_path / "state.npz")
    assert files_of(tmp_path) == ["state.npz"]
    # Another start and seed: neither counts any more.
    second = Localizer(panorama_map, config(mode, monte_carlo={"particles": 300, "threads": 2}), seed=99)
    second.load_state(tmp_path / "state.npz")
    now, before = asked(second), asked(first)
    assert np.array_equal(now.pose, before.pose)
    assert now.message == before.message
    assert np.array_equal(now.best_place_votes, before.best_place_votes, equal_nan=True)
    rest = play(second, events[split:])
    assert len(rest) == len(expected) - cut - 1
    for one, other in zip(rest, expected[cut + 1 :], strict=True):
        assert same(one, other)
        assert one.message == other.message or "not finite" in one.message
        assert one.timestamp == other.timestamp


def test_a_state_that_does_not_fit_is_one_line_and_changes_nothing(panorama_map: PanoramaMap, drive: Drive, tmp_path) -> None:
    few = {"particles": 100}
    localizer = Localizer(panorama_map, config(monte_carlo=few))
    drive.play(localizer)
    good = tmp_path / "good.npz"
    localizer.save_state(good)
    content = good.read_bytes()
    for name, damaged in {
        "short": content[: len(content) // 2],
        "flipped": content[:3000] + bytes([content[3000] ^ 255]) + content[3001:],
        "text": b"hello",
        "empty": b"",
    }.items():
        (tmp_path / name).write_bytes(damaged)
    np.savez(tmp_path / "other.npz", header=np.frombuffer(b'{"format": "something/1"}', dtype=np.uint8))
    before = asked(localizer)
    for name, words in {
        "short": "not a saved state",
        "flipped": "not a saved state",
        "text": "not a saved state",
        "empty": "not a saved state",
        "other.npz": "something/1",
        "none": "no such file",
    }.items():
        with pytest.raises(StateError, match=words) as caught:
            localizer.load_state(tmp_path / name)
        assert len(caught.value.faults) == 1
        assert str(tmp_path / name) in str(caught.value)
    assert np.array_equal(asked(localizer).pose, before.pose)
    other = Localizer(panorama_map, config(monte_carlo={"particles": 101}))
    with pytest.raises(StateError, match=r"localizer\.monte_carlo\.particles = 100, now 101"):
        other.load_state(good)
    with pytest.raises(OutputError):
        localizer.save_state(tmp_path / "text" / "state.npz")


def test_a_state_of_another_map_is_refused(panorama_map: PanoramaMap, drive: Drive, tmp_path) -> None:
    localizer = Localizer(panorama_map, config(monte_carlo={"particles": 100}))
    localizer.save_state(tmp_path / "state.npz")
    elsewhere = Localizer(replace(panorama_map, name="elsewhere"), config(monte_carlo={"particles": 100}))
    with pytest.raises(StateError, match="another map than 'elsewhere'"):
        elsewhere.load_state(tmp_path / "state.npz")


def test_tracking_gives_the_poses_that_searching_gives(
    panorama_map: PanoramaMap, drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    near, observe_near = [], VotesModel.observe_near

    def watched(model: VotesModel, panorama: Panorama, expected: Expected) -> VoteField:
        near.append(expected)
        return observe_near(model, panorama, expected)

    monkeypatch.setattr(VotesModel, "observe_near", watched)
    played = [
        drive.play(Localizer(panorama_map, config(initial="known_pose", tracking=tracking), start_pose=drive.start))
        for tracking in (True, False)
    ]
    # Of a robot in so small a map, not every belief is narrow.
    assert 2 <= len(near) < len(played[0])
    for one, other in zip(*played, strict=True):
        assert one is not None
        assert other is not None
        assert one.status is other.status is Status.CONVERGED
        assert np.hypot(*(one.pose - other.pose)[:2]) < 0.02


def test_what_a_glance_does_not_prove_all_votes_confirm_without_a_second_look(
    panorama_map: PanoramaMap, drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = panorama_map.observation_model()
    panorama = panorama_map.unwrapper(None, None)(drive.images[3])
    assert isinstance(model, VotesModel)
    searched = model.observe(panorama)
    monkeypatch.setattr(PoseRefiner, "refine_best", _must_not_be_called)
    expected = Expected.of(drive.truth[3], 0.02, 0.2)
    assert expected is not None
    # Nor is there one where an image that is proven is compared with the whole map all the same.
    everywhere = replace(expected, everywhere=True)
    monkeypatch.setattr("panoloc_mcl.robot.observation.votes._SURE", 0.1)
    np.testing.assert_array_equal(model.observe_near(panorama, everywhere).votes, searched.votes)
    monkeypatch.setattr("panoloc_mcl.robot.observation.votes._SURE", 2.0)
    with pytest.raises(AssertionError, match="a second time"):
        model.observe_near(panorama, everywhere)
    confirmed = model.observe_near(panorama, expected)
    np.testing.assert_array_equal(confirmed.votes, searched.votes)
    assert confirmed.measurement is not None
    assert searched.measurement is not None
    assert np.hypot(*(confirmed.measurement.pose - searched.measurement.pose)[:2]) < 0.02
    monkeypatch.undo()
    # Votes that point elsewhere make it a search.
    far = max(drive.truth, key=lambda pose: np.hypot(*(pose - drive.truth[3])[:2]))
    astray = Expected.of(far, 0.02, 0.2)
    assert astray is not None
    found = model.observe_near(panorama, astray)
    assert found.measurement is not None
    np.testing.assert_array_equal(found.measurement.pose, searched.measurement.pose)


def _must_not_be_called(*_: Any, **__: Any) -> None:
    raise AssertionError("a pose was measured a second time")


def test_somebody_carried_away_while_tracked_is_seen_at_once(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map, config(initial="known_pose", tracking=True), start_pose=drive.start)
    drive.play(localizer)
    far = max(range(len(drive.truth)), key=lambda index: np.hypot(*(drive.truth[index] - drive.truth[-1])[:2]))
    # Odometry is silent about it.
    for step in (1, 2, 3):
        time = drive.times[-1] + 0.2 * step
        localizer.add_odometry(time, drive.odometry[-1][1])
        estimate = localizer.add_image(time, drive.images[far])
        assert estimate is not None
        if step == 1:
            assert estimate.status is not Status.CONVERGED or np.hypot(*(estimate.pose - drive.truth[far])[:2]) < 0.1
    assert np.hypot(*(estimate.pose - drive.truth[far])[:2]) < 0.1


def test_a_frozen_camera_is_told_and_not_believed(localizer: Localizer, drive: Drive) -> None:
    for time, pose in drive.odometry:
        localizer.add_odometry(time, pose)
    told = [localizer.add_image(time, drive.images[0]) for time in drive.times]
    assert told[-1] is not None
    assert Reason.IMAGE_FROZEN in told[-1].reasons
    assert "the camera is frozen" in told[-1].message
    assert localizer.images_skipped > len(told) - 4
    assert told[-1].status is Status.STALE
