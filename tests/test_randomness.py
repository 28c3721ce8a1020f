"""Streams of random numbers from one seed."""

from itertools import combinations

from tactile_viewgcn.randomness import stream, torch_seed


def test_a_stream_repeats_and_no_two_are_alike():
    keys = [(seed, purpose, *numbers) for seed in (0, 1) for purpose in ("draw", "trial")
            for numbers in ((), (0,), (1,), (0, 0), (0, 1))]  # fmt: skip
    drawn = {key: tuple(stream(*key).integers(2**63, size=2)) for key in keys}
    assert drawn == {key: tuple(stream(*key).integers(2**63, size=2)) for key in keys}
    assert all(drawn[a] != drawn[b] for a, b in combinations(keys, 2))


def test_torch_s_seeds_differ_by_purpose_and_seed():
    seeds = {
        torch_seed(seed, purpose) for seed in range(3) for purpose in ("order", "noise", "weights")
    }
    assert len(seeds) == 9 and all(0 <= seed < 2**63 for seed in seeds)
