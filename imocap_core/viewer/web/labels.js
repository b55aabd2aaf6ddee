// Names over the performers set apart, and over the cameras.

const NAME_M = 0.32; // of a name above the head's joint

class Labels {
  constructor(parent, page) {
    this.page = page;
    this.own = page.videos.map((video) => ["", "camera"].map((kind) =>
      Object.assign(parent.appendChild(document.createElement("span")), { className: kind, textContent: video.id })));
  }

  dress(theme) {
    this.own.forEach((both, i) => both.forEach((label) => {
      label.style.color = inksOf(this.page, theme)[i];
    }));
  }

  // view: the scene's; actors: those drawn; frames: of each video.
  place(view, actors, frames, state) {
    const { page } = this;
    page.videos.forEach((video, i) => {
      const actor = actors.find((a) => a.video === i), free = view.through < 0;
      const named = state.apart || (state.place === "one" && i === state.lead && page.videos.length > 1);
      const head = actor && free && named
        ? add(add(actor.joints[page.model.head], actor.offset), [0, NAME_M, 0]) : null;
      const wanted = state.cameras && state.on[i] && !video.excluded && !state.apart && free;
      const corner = wanted && !covers(view, video, frames[i], actors) ? mix(...pictureCorners(video, frames[i]).slice(0, 2), 0.5) : null;
      [head, corner].forEach((place, k) => {
        const at = place && landing(view.matrix, place, view.width / view.density, view.height / view.density);
        this.own[i][k].hidden = !at;
        if (at) this.own[i][k].style.transform = `translate(${at.x}px, ${at.y - 4}px) translate(-50%, -100%)`;
      });
    });
  }
}
