"""Streams of random numbers from one seed."""

from itertools import combinations, product

from tactile_viewgcn.randomness import stream, torch_seed


def test_a_stream_repeats_and_no_two_are_alike():
    keys = []
    for seed, purpose in product((0, 1), ("draw", "trial")):
        for numbers in ((), (0,), (1,), (0, 0), (0, 1)):
            keys.append((seed, purpose, *numbers))
    drawn = {key: tuple(stream(*key).integers(2**63, size=2)) for key in keys}
    assert drawn == {key: tuple(stream(*key).integers(2**63, size=2)) for key in keys}
    assert all(drawn[a] != drawn[b] for a, b in combinations(keys, 2))


def test_torch_s_seeds_differ_by_purpose_and_seed():
    pairs = product(range(3), ("order", "noise", "weights"))
    seeds = {torch_seed(seed, purpose) for seed, purpose in pairs}
    assert len(seeds) == 9 and all(0 <= seed < 2**63 for seed in seeds)
