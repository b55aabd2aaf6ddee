"""Results scored against the truth, as rows of numbers.

Reading order:
    scoreboard         every metric of one result: artifacts and the truth in their axes to rows of
                       numbers
    whole_body_scores  whole-body metrics of one result: each joint, rotations, the surface, the
                       motion in the world
    action_scores      all scores of one action: every result, the rounds of the loop, hands and
                       uncertainty
"""
