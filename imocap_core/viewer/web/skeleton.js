// A body as lines between its joints.

// joints: places of a pose; colors: of each joint, three numbers; alpha: of all.
function skeletonLines(parents, joints, colors, alpha, offset) {
  return parents.flatMap((parent, j) => {
    if (parent < 0) return [];
    const color = [...mix(colors[parent], colors[j], 0.5), alpha];
    return [[add(joints[parent], offset), add(joints[j], offset), color]];
  });
}
