"""How well the motion is determined: covariances and viewpoints."""
