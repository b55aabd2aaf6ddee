"""The style of the report's page: light or dark, and readable on a phone."""

STYLE = """
:root {
  --ink: #1d2227; --quiet: #4f5861; --line: #d9dee3; --paper: #ffffff; --accent: #28588a;
  --edge: #8f979f; --target: #f3e6d5; --good: #3d8b5f; --doubt: #c4622d; color-scheme: light dark;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ink: #e6eaee; --quiet: #aab3bd; --line: #343c45; --paper: #171c21; --accent: #86b7ea;
    --edge: #75818d; --target: #44361f; --good: #62b487; --doubt: #e28a55;
  }
  img.chart { filter: invert(.92) hue-rotate(180deg); }
  img.photo { filter: brightness(.88); }
}
* { box-sizing: border-box; }
body {
  font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; color: var(--ink); background: var(--paper);
  max-width: 1160px; margin: 2.2rem auto 5rem; padding: 0 1.2rem; overflow-wrap: break-word;
}
h1 { font-size: 1.7rem; margin: 0 0 .2rem; }
h2 {
  font-size: 1.25rem; margin: 3rem 0 .4rem; padding-top: .8rem; border-top: 1px solid var(--line);
}
h3 { font-size: .95rem; margin: 1.6rem 0 .4rem; }
p, figcaption, dd { color: var(--quiet); max-width: 80ch; }
li { max-width: 84ch; }
nav { font-size: .88rem; margin: .8rem 0 0; line-height: 2; }
nav a { margin-right: 1.1rem; white-space: nowrap; }
a { color: var(--accent); text-decoration: none; }
a:hover { text-decoration: underline; }
th a { color: inherit; border-bottom: 1px dotted var(--edge); }
.wide { overflow-x: auto; }
.wide:focus-visible { outline: 2px solid var(--accent); }
table { border-collapse: collapse; font-size: .83rem; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .7rem; text-align: left; border-bottom: 1px solid var(--line); }
th { font-weight: 600; vertical-align: bottom; max-width: 9.5rem; }
td { max-width: 60ch; }
td.n, td:first-child { white-space: nowrap; }
th:first-child, td:first-child { position: sticky; left: 0; background: var(--paper); }
td:first-child:last-child, td:first-child:not(:has(+ .n, + td + .n)) { white-space: normal; }
.n { text-align: right; }
.total td { border-bottom-color: var(--edge); font-weight: 600; }
figure { margin: 1.4rem 0; }
figcaption { font-size: .88rem; }
img { max-width: 100%; height: auto; }
details { margin: 1rem 0; }
summary { cursor: pointer; color: var(--accent); padding: .3rem 0; }
dt { margin-top: .6rem; font-weight: 600; font-size: .9rem; }
dt code { font-weight: 400; font-size: .8rem; color: var(--quiet); margin-left: .4rem; }
dd { margin: 0 0 0 1.2rem; font-size: .88rem; }
dt:target { background: var(--target); }
.verdict p { color: inherit; margin: .5rem 0; font-size: 1.05rem; }
.verdict { border-left: 4px solid var(--good); padding: .1rem 1rem; margin: .8rem 0; }
.doubt { border-left-color: var(--doubt); }
/* On a phone pictures keep a size at which their lettering can be read, and move sideways. */
@media (max-width: 760px) {
  body { font-size: 16px; margin: 1rem auto 3rem; padding: 0 .9rem; }
  .wide { margin: 0 -.9rem; padding: 0 .9rem; }
  .wide img { max-width: none; width: 860px; }
  th, td { padding: .4rem .6rem; }
  table, figcaption, dd { font-size: .9rem; }
  summary { padding: .6rem 0; }
  nav a { display: inline-block; padding: .3rem 0; }
  th:first-child, td:first-child { left: -.9rem; padding-left: .9rem; }
  ul { padding-left: 1.2rem; }
}
"""
