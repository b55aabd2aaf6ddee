"""sync: which frames of the videos show the same moment of the action (section 3.1; Eq. 1, 2)."""

from __future__ import annotations

from imocap_core.adapters.hints import event_sound, hints_of, with_one_offset, with_sound
from imocap_core.adapters.participants import known_mirrors
from imocap_core.adapters.synchronisation import synchronise_monocular
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, Sync
from imocap_core.cli import stage_main
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs


def run(ctx: Context, inputs: Inputs, params: Params) -> Sync:
    """Synchronise the monocular motions; the reference is a central video."""
    keypoints, initial = inputs.get(Keypoints), inputs.get(InitialSmpl)
    hints = hints_of(*ctx.hints(), keypoints, str(ctx.action_file()))
    ctx.progress(0.1, "comparing all pairs of frames")
    sound, files = None, ctx.event_sound()
    if files is not None:
        ctx.progress(0.05, "listening")
        sound = event_sound(files, keypoints)
        hints = with_sound(hints, sound.start_s, keypoints)
    mirrored = known_mirrors(ctx.mirrored(), keypoints)
    sync = synchronise_monocular(
        initial,
        keypoints,
        params.sync,
        ctx.rng(),
        mirrored=mirrored,
        hints=hints,
        cameras=inputs.get(CameraMotion),
    )
    if sound is None:
        return sync
    notes = [*sound.notes, *sync.notes]
    sync = sync.model_copy(update={"notes": notes, "sound_start_s": sound.start_s})
    return with_one_offset(sync, keypoints, sound.start_s)


if __name__ == "__main__":
    raise SystemExit(stage_main("sync"))
