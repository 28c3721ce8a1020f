"""A record of a stage, in which each test changes what it is about."""

from tactile_viewgcn.provenance import Record

RECORD = Record(
    stage="pretrain",
    seconds=9.0,
    peak_mb=50.5,
    inputs={"frames": {"path": "f.h5", "md5": "ab"}},
    counts={"weights.backbone": 7},
    curves={"loss": [3.0, 2.0]},
    params={"values": {"pretrain.lr": 0.01}},
    notes=[],
    origin={"time": "2026-01-02T03:04:05+00:00"},
)
