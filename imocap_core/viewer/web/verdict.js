// What the result is worth: the verdict line, and the spans of videos that it warns of.

const LEVELS_IN_WORDS = { good: "Good", check: "Check", doubt: "Doubtful" };

// Fill the line; a finding that has a place goes there when it is clicked.
function makeVerdict(page, act) {
  const { level, summary, findings } = page.verdict ?? {};
  $("verdict").hidden = !level;
  if (!level) return;
  $("verdict").dataset.level = level;
  $("level").textContent = LEVELS_IN_WORDS[level];
  $("summary").textContent = summary.join(" ");
  for (const finding of findings) {
    const item = $("findings").appendChild(document.createElement("li"));
    if (finding.first === null) { item.textContent = finding.sentence; continue; }
    const button = item.appendChild(document.createElement("button"));
    button.textContent = finding.sentence;
    button.addEventListener("click", () => {
      $("verdict").open = false;
      act.play(false); act.toggle(finding.video, true); act.seek(finding.first);
    });
  }
  addEventListener("pointerdown", (e) => { if (!$("verdict").contains(e.target)) $("verdict").open = false; });
}

// The findings about spans of a video; of all videos that are shown and warned of at a moment.
const spansOf = (page, i) => (page.verdict?.findings ?? []).filter((f) => f.serious && f.video === i && f.first !== null);

function warningAt(page, state) {
  const inside = (f) => state.phase >= f.first - 1e-6 && state.phase <= f.last + 1e-6;
  return page.videos.flatMap((_, i) => (state.on[i] ? spansOf(page, i).filter(inside) : [])).map((f) => f.sentence).join(" ");
}

// Slanted lines over a span of a lane.
function hatch(pen, from, to, top, height, color) {
  pen.save();
  pen.beginPath(); pen.rect(from, top, Math.max(to - from, 3), height); pen.clip();
  pen.strokeStyle = color; pen.lineWidth = 2;
  pen.beginPath();
  for (let x = from - height; x < Math.max(to, from + 3) + height; x += 6) {
    pen.moveTo(x, top + height); pen.lineTo(x + height, top);
  }
  pen.stroke();
  pen.strokeRect(from, top, Math.max(to - from, 3), height);
  pen.restore();
}
