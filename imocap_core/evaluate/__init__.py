"""Results scored against the truth, as rows of numbers.

results          the results of an action's stages that are compared
truth            an action's truth, in the axes and at the frames of the results
body_points      points of a posed body that a result's joints do not include
scoreboard       every metric of one result
surface          surfaces of recovered and true bodies
whole_body       whole-body and world metrics of one result
hands            errors of the hands; calibration: errors over claimed standard deviations
action_scores    all of these for one action
"""
