"""Cycle consistency of the pairwise maps (Eq. 2): a map from video i to video j, and the maps
through any third video, agree.

Reading order:
    report         outcome of a method: iterations, convergence
    softmap        composition of stochastic maps: P_ij <- mean over k of P_ik P_kj
    row_contrast   affinities by how far they stand out in their row, the input of Eq. 2
    admm           steps that the two solvers of Eq. 2 share
    als            Eq. 2 by low-rank factors (MatchALS, Zhou et al., ICCV 2015)
    svt            Eq. 2 by singular-value thresholding (Dong et al., CVPR 2019)
    methods        the methods by name, and the choice by held-out residual
"""
