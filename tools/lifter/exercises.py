"""What people do, as key poses: exercises, everyday actions, sports; thousands of each at once.

A recipe draws the keys of N performances (`anatomy.Goals`, one a key). Ranges are those of ordinary
people, chosen by eye on pictures of the poses; nothing is measured on anybody.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lifter.anatomy import CHEST, WORLD, Goals
from lifter.arms import (
    HOLDS,
    Arms,
    Draw,
    any_of,
    anywhere,
    at_head,
    behind,
    behind_head,
    crossed,
    forward,
    guard,
    hanging,
    mixed,
    on_thighs,
    one_object,
    overhead,
    raised,
    reaching,
    sideways,
    two_arms,
)

Keys = list[Goals]


def stand(d: Draw, arms: Arms, wide: tuple[float, float] = (0.03, 0.22)) -> Goals:
    """Upright on straight legs."""
    feet = np.zeros((d.count, 2, 3))
    half = d.u(*wide)
    feet[:, 0, 0], feet[:, 1, 0] = 0.06 + half, -0.06 - half
    feet[:, :, 2] = d.n(0.0, 0.03, 2)
    one = np.zeros(d.count)
    return Goals(
        lean=d.n(1, 3), roll=d.n(0, 1.5), yaw=d.n(0, 4),
        spine=d.n(0, 1, 3) * (5, 3, 3), neck=d.n(0, 1, 3) * (10, 12, 4), feet=feet,
        foot_yaw=d.both(0, 26), heel=np.zeros((d.count, 2)), knee_out=d.n(0, 5, 2),
        least_knee=np.maximum(d.n(1.5, 2.5), -3), height=one + np.nan, share=d.n(0.5, 0.08),
        leg=np.zeros((d.count, 2, 4)), toes=d.both(-5, 20), planted=one == 0,
        flat_hands=one > 0, ahead=d.n(0.0, 0.015), level=one, **arms,
    )  # fmt: skip


def raise_arms(d: Draw) -> Keys:
    a, b = two_arms(d, 0.25)
    up = stand(d, a)
    return [up, up.but(**b, spine=up.spine + d.n(0, 3, 3), neck=up.neck + d.n(0, 6, 3))]


def squat(d: Draw) -> Keys:
    a, b = two_arms(d, 0.6)
    up = stand(d, a, (0.04, 0.24)).but(neck=d.n(-4, 8, 3) * (1, 0.5, 0.3))
    deep = d.u(0.0, 1.0)
    low = up.but(
        **b, height=0.86 - 0.58 * deep, lean=8 + 42 * d.rng.beta(2, 2, d.count) * (0.5 + deep / 2),
        knee_out=up.foot_yaw + d.both(0, 22), foot_yaw=up.foot_yaw,
        heel=np.where(d.some(0.3) & (deep > 0.6), d.u(0, 28), 0.0)[:, None],
        neck=up.neck - (10 * deep)[:, None] * (1, 0, 0), spine=d.n(0, 1, 3) * (9, 2, 2),
    )  # fmt: skip
    return [up, low]


def lunge(d: Draw) -> Keys:
    a, b = two_arms(d, 0.6)
    up = stand(d, a, (0.0, 0.08))
    feet = up.feet.copy()
    feet[:, 0, 2] += d.u(0.1, 0.5)
    feet[:, 1, 2] -= d.u(0.2, 0.6)
    low = up.but(
        feet=feet,
        height=d.u(0.42, 0.85),
        lean=d.n(6, 8),
        share=d.u(0.4, 0.7),
        heel=np.stack([0 * deg0(d), d.u(25, 75)], 1),
        foot_yaw=d.n(4, 6, 2),
        **b,
    )
    split = up.but(feet=feet, heel=low.heel * 0.6, foot_yaw=low.foot_yaw)
    start = np.where(d.some(0.5)[:, None, None], feet, up.feet)
    first = split.but(
        feet=start, heel=np.where((start == feet).all((1, 2))[:, None], split.heel, 0)
    )
    return [first, low]


def deg0(d: Draw) -> np.ndarray:
    return np.zeros(d.count)


def side_lunge(d: Draw) -> Keys:
    a, b = two_arms(d, 0.5)
    up = stand(d, a, (0.25, 0.5))
    low = up.but(
        height=d.u(0.45, 0.85),
        share=d.u(0.75, 1.0),
        lean=d.u(5, 45),
        knee_out=d.n(10, 6, 2),
        spine=d.n(0, 8, 3),
        **b,
    )
    return [up, low]


def bend(d: Draw) -> Keys:
    """Bowing, good mornings, dead lifts, side bends and turns."""
    a, b = two_arms(d, 0.6)
    up = stand(d, a)
    lean, back = d.u(15, 95), d.u(-5, 70)
    low = up.but(lean=lean, spine=np.stack([back, d.n(0, 12), d.n(0, 8)], 1), least_knee=d.u(0, 30),
                 neck=np.stack([d.n(-10, 20), d.n(0, 15), d.n(0, 6)], 1), **b)  # fmt: skip
    turn = up.but(
        lean=d.n(0, 5),
        yaw=up.yaw + d.n(0, 15),
        foot_yaw=up.foot_yaw,
        roll=d.n(0, 8),
        spine=d.n(0, 1, 3) * (12, 28, 22),
        neck=d.n(0, 1, 3) * (10, 25, 8),
        **b,
    )
    return [up, _either(d.some(0.65), low, turn)]


def _either(which: np.ndarray, a: Goals, b: Goals) -> Goals:
    names = a.__dataclass_fields__
    return Goals(**{k: np.where(which.reshape(-1, *[1] * (getattr(a, k).ndim - 1)),
                                getattr(a, k), getattr(b, k)) for k in names})  # fmt: skip


def lift(d: Draw) -> Keys:
    """Something from the floor to the hips, the chest or overhead."""
    up = stand(d, one_object(d), (0.05, 0.25))
    height, half = d.u(0.05, 0.45), d.u(0.06, 0.24)
    hands = np.zeros((d.count, 2, 3))
    hands[:, 0, 0], hands[:, 1, 0] = half, -half
    hands[..., 1] = height[:, None]
    hands[..., 2] = d.u(0.12, 0.38, 1)
    low = up.but(hands=hands, axes=np.full((d.count, 2), WORLD), height=d.u(0.38, 0.8),
                 lean=d.u(25, 75), spine=np.stack([d.u(0, 45), d.n(0, 6), d.n(0, 5)], 1),
                 neck=d.n(0, 1, 3) * (12, 6, 3) - (15, 0, 0), knee_out=up.foot_yaw + d.both(0, 15),
                 elbow=np.full((d.count, 2, 3), np.nan))  # fmt: skip
    hang = raised(d, d.both(5, 30), d.both(-25, 20), d.both(2, 20))
    end = mixed(d.some(0.4), hang, mixed(d.some(0.5), overhead(d), one_object(d)))
    return [low, up.but(**end, spine=d.n(-2, 5, 3))]


def _prop(d: Draw, base: Goals, **goals: np.ndarray) -> Goals:
    """On toes, knees or seat, the lowest of which touches the floor."""
    return base.but(planted=np.zeros(d.count, bool), **goals)


def _hands_down(d: Draw, half: np.ndarray, ahead: np.ndarray) -> Arms:
    """Hands on the floor below the shoulders: half their distance, ahead of the shoulders' line."""
    hands = np.stack([half[:, None] * (1.0, -1.0), d.n(0.05, 0.003, 2),
                      ahead[:, None] + d.n(0, 0.02, 2)], -1)  # fmt: skip
    return reaching(d, hands, WORLD, elbow=(0.8, 0.0, -0.8), swivel=15.0)


def push_up(d: Draw) -> Keys:
    """Push-ups on toes or knees, planks, from hands."""
    knees = d.some(0.35)
    body = np.where(knees, 0.88, 1.3)  # from what rests on the floor to the shoulders
    half, wide = d.u(0.14, 0.4), d.n(0, 3, 2)
    hip, pike = d.n(4, 8), np.where(d.some(0.15), d.u(10, 60), 0.0)
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0] = (np.where(knees, hip, hip + pike))[:, None] + d.n(0, 2, 2)
    leg[..., 1], leg[..., 3] = (
        d.u(0, 12, 1) + wide,
        np.where(knees, d.u(40, 110), d.u(0, 8))[:, None],
    )
    toes = np.where(knees, 30.0, -35.0)[:, None] + d.n(0, 6, 2)
    base = stand(d, hanging(d)).but(
        leg=leg,
        toes=toes,
        spine=d.n(0, 1, 3) * (6, 2, 2),
        neck=np.stack([d.n(-8, 16), d.n(0, 10), d.n(0, 3)], 1),
    )
    tall = 0.05 + np.sqrt(np.maximum(0.48**2 - (half - 0.17) ** 2, 0.05))
    keys = []
    for shoulder in (tall * d.u(0.92, 1.0), d.u(0.1, 0.3)):
        rise = np.degrees(np.arcsin(np.clip((shoulder - 0.08) / body, 0, 1)))
        down = base.but(lean=90 - rise + np.where(knees, 0, leg[:, 0, 0]) * 0.65)
        ahead = 0.49 + d.n(0.0, 0.03)
        pose = _prop(d, down, **_hands_down(d, half, ahead), flat_hands=np.ones(d.count, bool))
        keys.append(pose.but(level=np.ones(d.count)))
    return [keys[0], _either(d.some(0.85), keys[1], keys[0])]


def all_fours(d: Draw) -> Keys:
    """Crawling, bear walks, mountain climbers: hands and knees or feet, one leg drawn up."""
    bear, lean = d.some(0.4), d.u(78, 98)
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0] = np.where(bear, d.u(75, 115), d.u(75, 100))[:, None] + d.n(0, 8, 2)
    leg[..., 3] = np.where(bear, d.u(30, 95), d.u(80, 100))[:, None] + d.n(0, 6, 2)
    leg[..., 1] = d.u(0, 14, 1)
    arms = raised(d, d.both(70, 100) + d.n(0, 8, 2), d.both(-8, 25), d.both(2, 20))
    base = stand(d, arms).but(lean=lean, leg=leg, spine=d.n(0, 1, 3) * (15, 6, 6),
                              neck=np.stack([d.n(-15, 15), d.n(0, 12), d.n(0, 4)], 1),
                              flat_hands=np.ones(d.count, bool), toes=d.both(-30, 50))  # fmt: skip
    other = leg.copy()
    other[:, 0] += d.n(0, 1, 4) * (18, 3, 3, 12)
    other[:, 1, (0, 3)] += np.where(d.some(0.3)[:, None], np.array([-70.0, -70.0]), 0.0)
    steps = raised(d, d.both(70, 100) + d.n(0, 18, 2), d.both(-8, 25), d.both(2, 25))
    return [_prop(d, base), _prop(d, base.but(leg=other, **steps, spine=d.n(0, 1, 3) * (15, 8, 8)))]


def elbow_plank(d: Draw) -> Keys:
    arms = raised(d, d.both(72, 98), d.both(-10, 25), d.both(75, 105), elbow=(0.2, -1.0, 0.4))
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 3] = d.n(4, 8, 1) + d.n(0, 2, 2), d.u(0, 10, 1)
    base = stand(d, arms).but(lean=d.u(80, 92), leg=leg, toes=d.both(-45, -25),
                              spine=d.n(0, 1, 3) * (8, 3, 3), neck=d.n(-5, 12, 3))  # fmt: skip
    other = leg.copy()
    other[:, 0] += d.u(-15, 60, 1) * (1, 0.3, 0.2, 0.8)
    side = base.but(yaw=d.n(0, 5), lean=d.n(0, 4), roll=d.u(62, 80), leg=leg * 0.5, **anywhere(d))
    return [_prop(d, base), _either(d.some(0.7), _prop(d, base.but(leg=other)), _prop(d, side))]


def _lie(d: Draw, arms: Arms) -> Goals:
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 1], leg[..., 3] = d.n(4, 5, 2), d.both(0, 22), d.u(0, 10, 1)
    leg[..., 2] = d.both(0, 30)
    return stand(d, arms).but(leg=leg, lean=d.n(-90, 4), roll=d.n(0, 3), toes=d.both(0, 40),
                              planted=np.zeros(d.count, bool), spine=d.n(0, 1, 3) * (6, 4, 4),
                              neck=d.n(0, 1, 3) * (12, 14, 5))  # fmt: skip


def lie(d: Draw) -> Keys:
    """On the back, the front or a side: resting, pressing, leg raises."""
    a, b = two_arms(d, 0.3)
    first, leg = _lie(d, a), _lie(d, b).leg.copy()
    prone, side = d.some(0.3), d.some(0.2)
    rise = np.where(prone, d.u(-22, 0), np.where(d.some(0.5), d.u(10, 100), 0.0))
    leg[..., 0] += rise[:, None] + np.where(prone, 3.0, 10.0)[:, None] * d.n(0, 1, 2)
    leg[..., 3] += np.where(d.some(0.6), d.u(0, 110), 0.0)[:, None]
    over = np.where(prone, 180.0, 0.0)
    turn = np.where(side & ~prone, 90.0, 0.0)
    second = first.but(
        leg=leg,
        **b,
        neck=d.n(0, 15, 3) - np.where(prone, 20, 0)[:, None] * (1, 0, 0),
        spine=d.n(0, 5, 3) - np.where(prone, d.u(0, 30), 0)[:, None] * (1, 0, 0),
    )
    return [k.but(lean=first.lean + over, roll=first.roll + turn) for k in (first, second)]


def sit_up(d: Draw) -> Keys:
    """Sit-ups, crunches, V-ups with bent or straight legs."""
    arms = any_of(d, (behind_head, behind_head, crossed, forward, at_head, one_object))
    knee = np.where(d.some(0.75), d.u(60, 125), d.u(0, 25))
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 1], leg[..., 3] = (
        (knee / 2 + d.n(0, 4))[:, None],
        d.both(0, 14),
        knee[:, None],
    )
    down = _lie(d, arms).but(leg=leg, toes=d.both(-5, 30))
    rise, curl = d.u(0, 90), d.u(10, 65)
    risen = leg.copy()
    risen[..., 0] = np.clip(leg[..., 0] + rise[:, None], 0, 138)
    spine = np.stack([curl, d.n(0, 10), d.n(0, 5)], 1)
    up = down.but(
        lean=down.lean + rise,
        leg=risen,
        spine=spine,
        neck=d.n(0, 1, 3) * (15, 8, 4) + (10, 0, 0),
        **mixed(d.some(0.8), arms, forward(d)),
    )
    return [down, up]


def bridge(d: Draw) -> Keys:
    """The pelvis lifted off the floor: shoulders and feet, or hands and feet."""
    arms = any_of(d, (hanging, hanging, crossed, sideways))
    knee = d.u(75, 115)
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 1], leg[..., 3] = (knee / 2)[:, None], d.both(0, 12), knee[:, None]
    down = _lie(d, arms).but(leg=leg, toes=d.both(-10, 15))
    high, tilt = leg.copy(), d.u(10, 36)
    thigh = np.degrees(np.arcsin(np.clip(0.9 - 1.25 * np.sin(np.radians(tilt)), -0.1, 0.9)))
    high[..., 0], high[..., 3] = (tilt - thigh)[:, None], (90 + thigh + d.n(0, 8))[:, None]
    up = down.but(leg=high, lean=-90 - tilt, neck=d.n(20, 8, 3) * (1, 0.2, 0.1))
    wheel = down.but(
        leg=high - (15, 0, 0, 25),
        lean=-90 - d.u(5, 30),
        **overhead(d),
        spine=-d.u(20, 60, 1) * (1.0, 0, 0),
        neck=d.n(-30, 10, 3) * (1, 0.1, 0.1),
    )
    return [down, _either(d.some(0.75), up, wheel)]


def kneel(d: Draw) -> Keys:
    """On both knees or one, tall or on the heels."""
    a, b = two_arms(d, 0.4)
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 1], leg[..., 3] = d.n(2, 6, 1), d.both(0, 18), d.u(80, 100, 1)
    tall = stand(d, a).but(leg=leg, toes=d.both(-20, 55))
    low = leg.copy()
    heel = d.u(0.3, 1.0)
    low[..., 0], low[..., 3] = (60 * heel)[:, None] + d.n(20, 6, 1), (90 + 55 * heel)[:, None]
    on_heels = tall.but(leg=low, lean=d.n(8, 10), spine=d.n(0, 1, 3) * (15, 6, 5), **b)
    half = leg.copy()
    half[:, 0, 0], half[:, 0, 3] = d.u(70, 100), d.u(75, 105)
    one = tall.but(leg=half, **b)
    return [_prop(d, tall), _prop(d, _either(d.some(0.6), on_heels, one))]


def sit(d: Draw) -> Keys:
    """On a seat, getting up from it, or on the floor."""
    a, b = two_arms(d, 0.4)
    a = mixed(d.some(0.4), on_thighs(d), a)
    up = stand(d, b, (0.0, 0.15))
    feet = (
        up.feet
        + np.stack([deg0(d), deg0(d), d.u(0.28, 0.55)], 1)[:, None]
        + d.n(0, 0.04, 2, 3) * (1, 0, 1)
    )
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 1], leg[..., 3] = (
        d.n(80, 10, 1) + d.n(0, 4, 2),
        d.both(-2, 22),
        d.u(60, 110, 1) + d.n(0, 6, 2),
    )
    seat = up.but(
        leg=leg,
        lean=d.n(-4, 10),
        spine=np.stack([d.n(12, 10), d.n(0, 8), d.n(0, 5)], 1),
        **a,
        planted=np.zeros(d.count, bool),
        neck=d.n(0, 1, 3) * (14, 16, 5),
        height=deg0(d),
    )
    rising = up.but(feet=up.feet, height=d.u(0.48, 0.7), lean=d.u(20, 50), **a)
    floor = leg.copy()
    cross = d.some(0.4)
    floor[..., 0] = np.where(cross, d.u(80, 110), d.u(70, 100))[:, None]
    floor[..., 1:3] = np.where(
        cross[:, None, None], d.u(20, 45, 2, 2), d.both(0, 18)[..., None] * (1, 0.5)
    )
    floor[..., 3] = np.where(cross, d.u(100, 135), d.u(0, 60))[:, None] + d.n(0, 5, 2)
    low = seat.but(leg=floor, lean=d.n(-8, 14), toes=d.both(0, 40))
    other = low.but(**b, spine=d.n(15, 14, 3) * (1, 0.6, 0.4), lean=low.lean + d.u(-10, 35))
    kind = d.rng.random(d.count)
    first = _either(kind < 0.5, low, _either(kind < 0.75, seat, rising))
    second = _either(
        kind < 0.5, other, _either(kind < 0.75, seat.but(**b, spine=d.n(10, 12, 3)), up)
    )
    del feet
    return [first, second]


def strike(d: Draw) -> Keys:
    """Throws, swings of rackets, clubs and bats, punches: a wide stance and a trunk that turns."""
    a, b = any_of(d, (one_object, anywhere, guard)), any_of(d, (one_object, anywhere))
    both = d.some(0.5)
    wind, follow = mixed(both, one_object(d), anywhere(d)), mixed(both, one_object(d), anywhere(d))
    place = mixed(both, one_object(d), b)
    ready = stand(d, mixed(both, one_object(d), a), (0.05, 0.4))
    feet = ready.feet + d.n(0, 0.12, 2, 3) * (0.4, 0, 1)
    ready = ready.but(
        feet=feet, least_knee=d.u(4, 35), lean=d.u(0, 40), foot_yaw=d.both(-10, 40, 0.3)
    )
    turn, keys = d.u(15, 60), [ready]
    for arms, way in ((wind, -1.0), (place, d.u(0.0, 0.6)), (follow, d.u(0.5, 1.2))):
        spine = np.stack([d.n(6, 10), way * turn * 0.6, d.n(0, 10)], 1)
        keys.append(ready.but(
            **arms, yaw=way * turn * 0.5, spine=spine, share=np.clip(0.5 + 0.35 * way, 0.1, 0.9),
            foot_yaw=ready.foot_yaw - (way * turn * 0.5)[:, None] * (1, -1) * 0.6,
            lean=ready.lean + d.n(0, 6), least_knee=d.u(3, 30), roll=d.n(0, 6),
            neck=np.stack([d.n(0, 8), -0.7 * way * turn, d.n(0, 5)], 1),
            heel=np.stack([deg0(d), np.where(way > 0.3, d.u(0, 45), 0.0)], 1) * (1, 1),
        ))  # fmt: skip
    return keys


def kick(d: Draw) -> Keys:
    """One foot off the floor: kicks, knee lifts, balances, steps."""
    a, b = two_arms(d, 0.3)
    up = stand(d, a, (0.0, 0.1)).but(share=d.u(0.85, 1.0), least_knee=d.u(1, 18))
    keys = []
    for swing in (d.u(-0.6, -0.1), d.u(-0.1, 0.8)):
        feet = up.feet.copy()
        feet[:, 1, 2] += swing
        feet[:, 1, 1] = (
            0.06 + d.u(0.0, 0.75) * np.abs(swing) + np.where(d.some(0.4), d.u(0, 0.4), 0.0)
        )
        feet[:, 1, 0] += d.n(-0.03, 0.12)
        keys.append(up.but(feet=feet, lean=d.n(0, 9) - 12 * swing, spine=d.n(0, 8, 3),
                           heel=np.stack([np.where(d.some(0.2), d.u(0, 40), 0.0), d.u(-10, 60)], 1),
                           **(b if swing.mean() > 0 else a)))  # fmt: skip
    return [up.but(share=d.n(0.5, 0.1)), *keys]


def walk(d: Draw) -> Keys:
    """Walking and running, on the spot: foot contact and passing, of both sides."""
    fast = d.some(0.35)
    stride, soft = (
        np.where(fast, d.u(0.2, 0.5), d.u(0.12, 0.36)),
        np.where(fast, d.u(12, 32), d.u(2, 9)),
    )
    base = stand(d, hanging(d), (0.0, 0.04)).but(lean=d.n(3, 3) + 6 * fast, least_knee=soft)
    swing, elbow = d.u(5, 38), np.where(fast, d.u(60, 110), d.u(5, 45))
    keys = []
    for step in (1.0, -1.0):
        for passing in (False, True):
            feet = base.feet.copy()
            feet[:, :, 2] += stride[:, None] * np.array([step, -step]) * (-0.25 if passing else 1)
            back = np.array([step < 0, step > 0])
            heel = np.where(back, d.u(12, 45, 1), 0.0)
            if passing:
                feet[..., 1] += np.where(
                    back, np.where(fast, d.u(0.2, 0.5), d.u(0.06, 0.16))[:, None], 0
                )
            forth = swing[:, None] * np.array([-step, step]) * (0.1 if passing else 1.0) + 5
            arms = raised(
                d, np.abs(forth), np.where(forth < 0, 165.0, 8.0), elbow[:, None] + d.n(0, 5, 2)
            )
            turn = np.stack([d.n(3, 2), -step * d.u(0, 12) * (not passing), d.n(0, 2)], 1)
            share = np.where(passing, 0.95 if step > 0 else 0.05, 0.5)
            keys.append(base.but(feet=feet, heel=heel, **arms, spine=turn, share=share))
    return [*keys, keys[0]]


def jump(d: Draw) -> Keys:
    """Crouch, flight, landing; jumping jacks."""
    a, b = two_arms(d, 0.3)
    up = stand(d, a).but(least_knee=d.u(2, 12))
    low = up.but(height=d.u(0.5, 0.85), lean=d.u(5, 45), **any_of(d, (hanging, behind, anywhere)))
    leg = np.zeros((d.count, 2, 4))
    tucked = d.some(0.4)
    leg[..., 0] = np.where(tucked, d.u(20, 110), d.u(-10, 15))[:, None] + d.n(0, 12, 2)
    leg[..., 1], leg[..., 3] = (
        d.both(0, 35),
        np.where(tucked, d.u(30, 120), d.u(2, 30))[:, None] + d.n(0, 10, 2),
    )
    fly = _prop(d, up, leg=leg, **b, toes=d.both(10, 50), height=d.u(0.04, 0.6), lean=d.n(5, 12))
    return [up, low, fly, low.but(height=d.u(0.55, 0.88))]


def roll(d: Draw) -> Keys:
    """Somersaults: a ball that turns over."""
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 1], leg[..., 3] = d.u(95, 135, 1), d.both(0, 18), d.u(80, 140, 1)
    arms = raised(d, d.both(20, 80), d.both(0, 40), d.both(20, 90))
    ball = stand(d, arms).but(
        leg=leg,
        spine=np.stack([d.u(35, 80), d.n(0, 5), d.n(0, 5)], 1),
        neck=np.stack([d.u(20, 50), d.n(0, 5), d.n(0, 5)], 1),
        lean=d.n(50, 10),
    )
    return [_prop(d, ball.but(lean=ball.lean + turn, leg=leg + d.n(0, 8, 2, 4)))
            for turn in (0.0, 90.0, 180.0, 270.0, 360.0)]  # fmt: skip


def cartwheel(d: Draw) -> Keys:
    """Sideways over the hands, the legs apart."""
    leg = np.zeros((d.count, 2, 4))
    leg[..., 1], leg[..., 3], leg[..., 0] = d.both(15, 55), d.both(0, 15), d.n(0, 12, 2)
    arms = raised(d, d.both(130, 172), d.both(60, 95), d.both(2, 15))
    star = stand(d, arms).but(leg=leg, spine=d.n(0, 5, 3), neck=d.n(-10, 8, 3), toes=d.both(0, 45))
    return [_prop(d, star.but(roll=star.roll + turn, spine=d.n(0, 6, 3), leg=leg + d.n(0, 5, 2, 4)))
            for turn in (0.0, 80.0, 160.0, 240.0, 320.0)]  # fmt: skip


def handstand(d: Draw) -> Keys:
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 1], leg[..., 3] = d.n(0, 10, 2), d.both(0, 18), d.both(0, 15)
    arms = raised(d, d.both(160, 182), d.both(20, 100), d.both(2, 15))
    top = stand(d, arms).but(leg=leg, lean=d.n(180, 5), spine=d.n(-5, 6, 3), toes=d.both(20, 50),
                             neck=np.stack([d.n(-20, 12), d.n(0, 5), d.n(0, 3)], 1),
                             flat_hands=np.ones(d.count, bool))  # fmt: skip
    part = leg + d.n(0, 1, 2, 4) * (40, 8, 3, 25) + (20, 0, 0, 15)
    pike = top.but(lean=d.u(120, 165), leg=np.maximum(part, (0, 0, -30, 0)))
    return [_prop(d, pike), _prop(d, top)]


def hang(d: Draw) -> Keys:
    """Pull-ups: from a bar with straight arms and with bent ones."""
    half = d.both(-0.05, 0.2)
    low = raised(d, d.both(168, 180), d.both(60, 100), d.both(0, 12))
    hands = np.stack([half + 0.03, d.both(0.02, 0.2), d.both(0.05, 0.2)], -1)
    high = reaching(d, hands, CHEST, elbow=(0.8, -1.0, 0.2))
    leg = np.zeros((d.count, 2, 4))
    leg[..., 0], leg[..., 3] = d.u(-8, 35, 1) + d.n(0, 5, 2), d.u(0, 90, 1) + d.n(0, 5, 2)
    down = stand(d, low).but(leg=leg, toes=d.both(10, 50), height=d.u(0.1, 0.6), lean=d.n(3, 6))
    return [_prop(d, down), _prop(d, down.but(**high, height=down.height + 0.35, lean=d.n(-5, 8)))]


def dance(d: Draw) -> Keys:
    """Mixtures: any arms, feet that step, trunks that bend and turn, knees soft or straight."""
    base, keys = stand(d, anywhere(d), (0.0, 0.25)), []
    for _ in range(4):
        feet = base.feet + d.n(0, 1, 2, 3) * (0.1, 0, 0.16)
        feet[:, 0, 0], feet[:, 1, 0] = np.maximum(feet[:, 0, 0], 0.0), np.minimum(feet[:, 1, 0], 0)
        up = d.rng.random((d.count, 2)) < (0.3, 0.15)
        up[:, 1] &= ~up[:, 0]
        feet[..., 1] = np.where(up, d.u(0.05, 0.45, 2), 0.0)
        share = np.where(up[:, 0], 0.05, np.where(up[:, 1], 0.95, d.u(0.3, 0.7)))
        keys.append(
            base.but(
                feet=feet,
                share=share,
                **mixed(d.some(0.3), any_of(d, HOLDS), anywhere(d)),
                lean=d.n(4, 9),
                roll=d.n(0, 5),
                yaw=d.n(0, 18),
                spine=d.n(0, 1, 3) * (12, 14, 11),
                neck=d.n(0, 1, 3) * (12, 18, 8),
                foot_yaw=d.both(-5, 35, 0.3),
                heel=np.where(d.some(0.3)[:, None], d.u(0, 40, 2), 0.0),
                least_knee=np.where(d.some(0.5), d.u(0, 8), d.u(5, 50)),
            )
        )
    return keys


RECIPES: dict[str, tuple[Callable[[Draw], Keys], float]] = {
    "raise_arms": (raise_arms, 4.0),
    "squat": (squat, 2.5),
    "lunge": (lunge, 1.2),
    "side_lunge": (side_lunge, 0.6),
    "bend": (bend, 1.5),
    "lift": (lift, 1.0),
    "push_up": (push_up, 1.6),
    "all_fours": (all_fours, 0.8),
    "elbow_plank": (elbow_plank, 0.5),
    "lie": (lie, 1.2),
    "sit_up": (sit_up, 1.2),
    "bridge": (bridge, 0.6),
    "kneel": (kneel, 0.8),
    "sit": (sit, 1.5),
    "strike": (strike, 3.0),
    "kick": (kick, 1.5),
    "walk": (walk, 2.0),
    "jump": (jump, 1.2),
    "roll": (roll, 0.4),
    "cartwheel": (cartwheel, 0.4),
    "handstand": (handstand, 0.4),
    "hang": (hang, 0.7),
    "dance": (dance, 2.5),
}
"""Each recipe and its share of the performances."""
