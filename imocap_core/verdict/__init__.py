"""The verdict on a run, from its artifacts and without truth.

Reading order:
    findings        what a verdict is made of: findings with their frames, three sentences
    spans           runs of frames
    collapsed_time  a moving video matched to a single moment
    outlying_body   a body far from those of the other videos at the same moment
    sliding_feet    feet that stand still in the picture and move in space
    same_take       one recording given twice, re-timed, cropped or mirrored
    agreement       how well the videos' times agree
    decisions       what was left out or mirrored, and how to overrule it
    detections      missing people, cuts, other people, swapped sides, moving cameras
    weak_joints     ill-determined joints
    view_findings, physical_findings, prediction_findings
                    what no video shows, what bodies do not do, what the others do not predict
    further_view    what to film next
    summary         the three sentences
    limbs, take_findings, collapse_findings, body_findings, swapped_findings
                    the quantities above, of artifacts
    action_verdict  all of them, of an action's artifacts
    verdict_file    as JSON
"""
