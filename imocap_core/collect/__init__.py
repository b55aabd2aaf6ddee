"""`imocap collect`: from long films to the videos of an action.

Reading order:
    collect     from films to the list of what is in them, and the action of the chosen occurrences
    shots       shots of a film: the spans between its cuts and gradual transitions
    films       a long film looked through: its shots, and everybody detected and followed in it
    matching    occurrences of a template movement in tracks: subsequence DTW at several playback
                rates
    movement    the movement that is looked for: that of an example, or the one that is repeated
                most
    same_takes  occurrences that show one take, replays included, and the one of each group that
                stays
    listing     occurrences of the action, which of them become videos; collected.json and
                action.yaml
"""
