"""The verdict on a run, from its artifacts and without truth.

Reading order:
    findings            what a verdict is made of: findings about parts of videos, and at most three
                        sentences
    detection_findings  warnings of the detections, the people, the cameras, and what no video shows
    timing              how well the videos' times agree, what collapses, repeats, or was decided
                        about whole videos
    bodies              bodies unlike the others', other people, sliding feet, and what bodies do
                        not do
    contradictions      limbs that a detector sees where the recovered body has them elsewhere, or
                        hides them
    same_take           one recording given twice: re-timed, cropped or mirrored
    weak_joints         ill-determined joints, and what to film next
    action_verdict      the verdict on an action, from its artifacts, and its three sentences
"""
