"""A tiny call of every kernel, of the very types that the program calls it with.

Whoever adds a kernel adds its example here. Compiling a kernel means calling it, and another type would compile another kernel.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np


def _particles(count: int = 4) -> tuple[Any, ...]:
    return np.zeros(count, dtype=np.float32), np.zeros(count, dtype=np.float32), np.zeros(count, dtype=np.uint32)


def _predict() -> tuple[Any, ...]:
    return *_particles(), np.array([0.1, 0.2, 0.0, 0.1]), np.full(4, 0.01), 1, 2, 0, 4


def _read_field() -> tuple[Any, ...]:
    scores = np.ones((8, 2), dtype=np.float32)
    neighbours = np.zeros((4, 1), dtype=np.int32)
    weights = np.ones((4, 1), dtype=np.float32)
    return *_particles(), scores, np.zeros(0, dtype=np.int32), neighbours, weights, -1.0, -1.0, 1.0, 2, 2


def _grid() -> tuple[Any, ...]:
    return *_particles(), np.ones(4, dtype=np.float32), 0.4, 24


def _where_to_look() -> tuple[Any, ...]:
    return *_particles(), 8, -1.0, -1.0, 1.0, 2, 2, _integers(), _words(), _numbers()


def _weights_and_uniforms() -> tuple[Any, ...]:
    return np.ones(4, dtype=np.float32), np.full(4, 0.5)


def _solve_positive() -> tuple[Any, ...]:
    return np.eye(3, dtype=np.float32), 1e-5


def _equations() -> tuple[Any, Any]:
    """One hypothesis, six pixels, two filters, two eigenimages, and what is observed: transposed, and pixel by pixel."""
    return np.zeros((1, 3, 12), dtype=np.float32), np.zeros((1, 6, 6), dtype=np.float32)


def _trimmed_coefficients() -> tuple[Any, ...]:
    transposed, by_pixel = _equations()
    return transposed[0], by_pixel[0], np.zeros((1, 12), dtype=np.float32), 0.8, 4


def _numbers(count: int = 4) -> Any:
    return np.arange(count, dtype=np.float32)


def _integers(count: int = 4) -> Any:
    return np.arange(count, dtype=np.int32)


def _words() -> Any:
    return np.zeros(4, dtype=np.uint32)


def _flags() -> Any:
    return np.zeros(4, dtype=np.uint8)


def _matrix() -> Any:
    return np.eye(4, dtype=np.float32)


def _vote() -> tuple[Any, ...]:
    responses = np.ones((2, 4, 8), dtype=np.float32)
    pixels = np.zeros((1, 6), dtype=np.int32)
    back, mean = np.ones((1, 3, 2), dtype=np.float32), np.zeros((1, 12), dtype=np.float32)
    return responses, pixels, pixels, *_equations(), back, mean, np.eye(2), np.zeros(1), 0.8, 4, 0.3


def _normalised_gradients() -> tuple[Any, ...]:
    grey = np.linspace(0.0, 255.0, 40, dtype=np.float32).reshape(4, 10)
    return grey, np.zeros((4, 10), dtype=np.uint8), 1, 4.0, True


def _warp_table() -> tuple[Any, ...]:
    tangents = np.array([0.5, 0.1, -0.5])
    return np.full(8, 2.0), tangents, np.array([np.inf, np.inf, 1.2]), 0.1, 0.0, 0.6, 0.4, 8, 1


def _turned_table() -> tuple[Any, ...]:
    return np.array([0.5, 0.1, -0.5]), np.linspace(0.0, -5.5, 8), 0.3, np.eye(3), 0.6, 0.4, 8, 1


def _move_profile() -> tuple[Any, ...]:
    return np.full(8, 2.0), 0.1, 0.0


def _column_agreement() -> tuple[Any, ...]:
    features, usable = np.ones((3, 8), dtype=np.complex64), np.ones((3, 8), dtype=np.bool_)
    return features, usable, features, usable


def _column_products() -> tuple[Any, ...]:
    features, usable = np.ones((3, 8), dtype=np.complex64), np.ones((3, 8), dtype=np.bool_)
    profile, tangents = np.full(8, 2.0), np.array([0.5, 0.1, -0.5])
    return features, usable, features, usable, profile, np.array([np.inf, np.inf, 1.2]), tangents, 1


def _normal_equations() -> tuple[Any, ...]:
    return np.ones((24, 8)), np.ones(8, dtype=np.bool_), 0.1


#: By ``module.kernel``: the arguments of one call.
EXAMPLES: dict[str, Callable[[], tuple[Any, ...]]] = {
    "correlations.spectra_product": lambda: (*np.ones((2, 3, 4, 5), np.float32), np.ones((3, 4), np.complex64)),
    "correlations.to_votes": lambda: (_matrix(), np.ones((2, 4), dtype=np.float32), 0.7),
    "elementary.arctan2": lambda: (np.float32(0.5), np.float32(-0.5)),
    "elementary.exponential": lambda: (np.float32(0.5),),
    "elementary.logarithm": lambda: (np.float32(0.5),),
    "elementary.sine_cosine": lambda: (np.uint32(5),),
    "gradients.normalised_gradients": _normalised_gradients,
    "gradients.plain_gradients": lambda: _normalised_gradients()[:3],
    "filtering.hypotheses.add_moments": lambda: (
        np.zeros(4, dtype=np.int64),
        _numbers(),
        np.zeros((3, 4), dtype=np.float32),
        np.zeros(20),
    ),
    "filtering.hypotheses.keys_of": lambda: (np.zeros((3, 4), dtype=np.int32), 0, 0, 5, 24, np.zeros(4, dtype=np.int64)),
    "filtering.hypotheses.hypotheses": lambda: (*_grid(), 0.01),
    "filtering.hypotheses.in_cells": lambda: (
        *_particles(),
        0.4,
        24,
        np.zeros((3, 4), dtype=np.int32),
        np.zeros((3, 4), np.float32),
    ),
    "filtering.hypotheses.link_cells": lambda: (np.array([9, 10]), np.ones(2, dtype=np.bool_), 5, 3),
    "filtering.hypotheses.lowest_and_highest": lambda: (_numbers(),),
    "filtering.hypotheses.merge_cells": lambda: (np.zeros(2, dtype=np.int64), 1, np.zeros((2, 3)), np.ones((2, 10))),
    "filtering.hypotheses.occupied_cells": _grid,
    "filtering.hypotheses.slots_of": lambda: (np.zeros(4, dtype=np.int64), 4, _integers(1) - 1, np.zeros(1, dtype=np.int64), 0),
    "filtering.particles.in_turns": lambda: (np.float32(0.25),),
    "filtering.particles.likelihoods_there": lambda: (*_read_field(), 1.0, 0.5, 1.0, 0.01, _numbers()),
    "filtering.particles.look": lambda: (*_read_field()[3:7], _integers(), _words(), _numbers(), _numbers()),
    "filtering.particles.predict": _predict,
    "filtering.particles.read_field": _read_field,
    "filtering.particles.take": lambda: (*_particles(), np.arange(3), *_particles(3)),
    "filtering.particles.turn_and_drive": lambda: (*_particles(), np.zeros((4, 4), dtype=np.float32), np.zeros(4), np.zeros(4)),
    "filtering.particles.turned": lambda: (np.uint32(1), np.uint32(2), np.uint32(3)),
    "filtering.particles.where_to_look": _where_to_look,
    "filtering.random.normal_pair": lambda: (np.uint32(1), np.uint32(2)),
    "filtering.random.philox": lambda: tuple(np.uint64(word) for word in range(6)),
    "filtering.random.normal_pairs": lambda: (_words(), _words(), _numbers(), _numbers(), 4),
    "filtering.random.normals": lambda: (1, 2, 3, 0, 4),
    "filtering.random.words_of": lambda: (1, 2, 3, 0, 4, np.zeros((4, 4), dtype=np.uint32)),
    "filtering.resampling.multinomial": _weights_and_uniforms,
    "filtering.resampling.pick": _weights_and_uniforms,
    "filtering.resampling.residual": _weights_and_uniforms,
    "filtering.resampling.running_sums": lambda: (np.ones(4, dtype=np.float32), 0.5, np.zeros(8)),
    "filtering.resampling.stratified": _weights_and_uniforms,
    "filtering.resampling.systematic": lambda: (np.ones(4, dtype=np.float32), 0.5, 4),
    "selection.count_up_to": lambda: (_integers(), np.int32(2)),
    "selection.leave_out": lambda: (_integers(), 2, 0, _integers(5)),
    "selection.limit_of_smallest": lambda: (_integers(), 2, 1 << 29),
    "selection.remaining": lambda: (_flags(), _integers(5)),
    "voting.add": lambda: (_matrix(), _matrix(), -1),
    "voting.add_squares": lambda: (_numbers(), _numbers(), _numbers()),
    "voting.read": lambda: (_numbers(8), np.arange(4, dtype=np.uint32), np.uint32(1), np.float32(0.5), _numbers(), _numbers()),
    "voting.solve_positive": _solve_positive,
    "voting.take_rows": lambda: (_matrix(), _numbers(8), _integers(2), _matrix()),
    "voting.trimmed_coefficients": _trimmed_coefficients,
    "voting.vote": _vote,
    "warping.column_agreement": _column_agreement,
    "alignment.column_products": _column_products,
    "alignment.inner_products": lambda: (*_column_agreement(), 1),
    "warping.turned_table": _turned_table,
    "warping.features_of_planes": lambda: (np.ones((3, 8, 4), dtype=np.float32),),
    "warping.move_profile": _move_profile,
    "alignment.normal_equations": _normal_equations,
    "alignment.agreeing_columns": lambda: (np.ones((3, 8)), 1, 0.6),
    "alignment.sector_pulls": lambda: (*_normal_equations(), 4),
    "warping.warp_table": _warp_table,
    "filtering.weights.fallen": lambda: (np.float32(0.5), np.float32(1.0), np.float32(-2.0)),
    "filtering.weights.likelihoods": lambda: (_numbers(), 1.0, 0.5, 1.0, 0.01),
    "filtering.weights.normal_density": lambda: (np.zeros((4, 3)), np.zeros(3), np.eye(3), 0.0),
    "filtering.weights.scale": lambda: (_numbers(), 0.5),
    "filtering.weights.sums_of_likelihoods": lambda: (np.ones((4, 3), dtype=np.float32), 2, 1.0, 0.5, 1.0),
    "filtering.weights.to_likelihoods": lambda: (_numbers(), 1.0, 0.5, 1.0, 0.01),
    "filtering.weights.weigh": lambda: (_numbers(), _numbers(), 0.5, 0.01),
}


def find(name: str) -> Any:
    """The kernel of a name in ``EXAMPLES``."""
    module, _, function = name.rpartition(".")
    return getattr(importlib.import_module(f"panoloc_mcl.robot.kernels.{module}"), function)
