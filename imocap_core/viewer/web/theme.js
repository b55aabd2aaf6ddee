// Colours of the page's style for what is drawn by hand, and colours that can be read.

function rgb(hex) {
  return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
}

const css = (color) => `rgb(${color.map((c) => Math.round(255 * c)).join(",")})`;

// The style's variables as hexadecimal colours; light or dark as the reader's system is.
function readTheme() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "quiet", "line", "paper", "empty", "sky", "grid", "accent", "doubt"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

// The videos' colours as lines and letters on the page's paper.
function inksOf(page, theme) {
  return theme.inks ??= page.videos.map((video) => readable(video.color, theme.paper));
}

function onThemeChange(changed) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
}

// WCAG 2.2: relative luminance of a colour of three numbers from 0 to 1, and contrast of two.
function luminance(color) {
  const [r, g, b] = color.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function contrast(a, b) {
  const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
  return (high + 0.05) / (low + 0.05);
}

// The colour nearest to `hex` whose contrast to `ground` is at least 4.6: darker or lighter.
function readable(hex, ground) {
  const from = rgb(hex), on = rgb(ground), toward = luminance(on) > 0.18 ? [0, 0, 0] : [1, 1, 1];
  for (let share = 0; share < 1; share += 0.04) {
    const color = mix(from, toward, share);
    if (contrast(color, on) >= 4.6) return css(color);
  }
  return css(toward);
}

// Uncertainty as a colour, from certain (0) to 100 mm or more (1): blue, yellow, red.
const SURE = [[0.17, 0.44, 0.7], [0.45, 0.68, 0.75], [0.97, 0.86, 0.5], [0.93, 0.55, 0.26], [0.75, 0.16, 0.15]];

function uncertaintyColor(share) {
  const at = clamp(share, 0, 1) * (SURE.length - 1), low = Math.min(Math.floor(at), SURE.length - 2);
  return mix(SURE[low], SURE[low + 1], at - low);
}
