// What the curves show: a quantity and up to four joints.

const MOST_JOINTS = DASHES.length;

function makeChooser(page, act) {
  const names = page.model.joints.slice(0, BODY_JOINTS);
  for (const [key, { label }] of Object.entries(QUANTITIES))
    $("quantity").appendChild(new Option(label.replace(/ \(.*/, ""), key));
  $("quantity").addEventListener("change", () => act.quantity($("quantity").value));
  const boxes = names.map((name, j) => {
    const label = $("joints").appendChild(document.createElement("label"));
    const box = Object.assign(document.createElement("input"), { type: "checkbox" });
    label.append(box, name);
    box.addEventListener("change", () => act.joint(j, box.checked));
    return box;
  });
  addEventListener("pointerdown", (e) => { if (!$("chooser").contains(e.target)) $("chooser").open = false; });
  return (state) => {
    const { joints, quantity } = state.curves;
    $("quantity").value = quantity;
    boxes.forEach((box, j) => {
      box.checked = joints.includes(j);
      box.disabled = !box.checked && joints.length >= MOST_JOINTS;
    });
    const dash = ["―", "- -", "···", "- ·"];
    const said = joints.map((j, k) => (joints.length > 1 ? `${dash[k]} ${names[j]}` : names[j]));
    $("chosen").textContent = said.join("   ") || "no joint";
  };
}
