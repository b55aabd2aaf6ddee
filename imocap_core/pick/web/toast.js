// One sentence at the foot of the page, which screen readers read out.

const LONG_MS = 7000;
let timer = 0;

export function tell(sentence, { bad = false, undo = false } = {}) {
  const toast = document.getElementById("toast");
  document.getElementById("toast-text").textContent = sentence;
  document.getElementById("toast-undo").hidden = !undo;
  toast.classList.toggle("bad", bad);
  toast.classList.add("shown");
  clearTimeout(timer);
  timer = setTimeout(hide, bad ? 2 * LONG_MS : LONG_MS);
}

export function hide() {
  document.getElementById("toast").classList.remove("shown");
}
