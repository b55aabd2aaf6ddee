// The scene as a picture file, with what it shows and when.

// canvas: the scene, drawn in this very task; caption: a line below it.
function snapshot(canvas, caption, theme, name) {
  const bar = Math.round(canvas.width / 40) + 12, out = document.createElement("canvas");
  Object.assign(out, { width: canvas.width, height: canvas.height + bar });
  const pen = out.getContext("2d");
  pen.fillStyle = theme.paper; pen.fillRect(0, 0, out.width, out.height);
  pen.drawImage(canvas, 0, 0);
  pen.fillStyle = theme.ink; pen.textBaseline = "middle";
  pen.font = `${Math.round(bar * 0.52)}px system-ui, "DejaVu Sans", sans-serif`;
  pen.fillText(caption, bar / 3, canvas.height + bar / 2, out.width - bar);
  out.toBlob((blob) => {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }, "image/png");
}
