/* What the report does: spectra drawn from its numbers, read-outs under plots, cards that open. */
{
  const numbers = JSON.parse(document.getElementById("spectrabox-results").textContent);
  const spectra = (numbers.regions ?? numbers.materials).map((one) => {
    const of = one.summary ?? {nm: one.inverse_rendering.nm, mean: one.inverse_rendering.reflectance};
    return {name: one.name, hex: one.colour.hex, nm: of.nm, mean: of.mean, lower: of.lower, upper: of.upper,
      truth: one.truth ?? undefined};
  });
  // A plot of all, where the pointer and open cards choose whose band is shown; marks on photos follow.
  const cards = [...document.querySelectorAll(".card")];
  const index = (element) => Number(element.dataset.surface);
  const said = document.querySelector(".all-spectra output"), unread = said.textContent;
  const light = (chosen) => document.querySelectorAll("a.mark, .card").forEach((one) =>
    one.classList.toggle("pointed", index(one) === chosen));
  const plot = spectraPlot("Reflectances over wavelength in nm, a line for each surface", spectra, {
    ...(matchMedia("(max-width: 600px)").matches ? { width: 400, height: 300 } : {}),   // its words stay as large
    onShow: (chosen, words) => { light(chosen); said.textContent = words || unread; },
    onChoose: (chosen) => {
      const card = cards.find((one) => index(one) === chosen), to = `#${card.id}`;
      if (location.hash === to) unfold(); else location.hash = to;
    },
  });
  document.getElementById("spectra").append(plot.svg);
  cards.forEach((card) => {
    const spectrum = spectra[index(card)];
    card.querySelector(".drawing").append(smallSpectrum(`Reflectance of ${spectrum.name} over wavelength in nm`, spectrum));
    card.querySelector("details").addEventListener("toggle", () =>
      plot.choose(cards.filter((one) => one.querySelector("details").open).map(index)));
  });
  // The patches of the chart: what is estimated of each without it, beside the reference.
  document.querySelectorAll(".patch").forEach((each) => {
    const {wavelengths_nm: nm, patches} = numbers.chart.left_out, patch = patches[Number(each.dataset.patch)];
    each.querySelector(".drawing").append(smallSpectrum(`Reflectance of patch ${patch.name} over wavelength in nm`,
      {nm, mean: patch.estimate, lower: patch.lower, upper: patch.upper, truth: {nm, values: patch.reference}}));
  });
  document.querySelectorAll("a.mark, .card").forEach((one) => {
    one.addEventListener("pointerenter", () => { plot.show(index(one)); light(index(one)); });
    one.addEventListener("pointerleave", () => { plot.show(-1); light(-1); });
  });
  // A read-out under each plot: the values of every series at the wavelength under the pointer.
  const SVG = document.querySelector("svg").namespaceURI;
  const valueAt = (xs, ys, x) => {
    let i = xs.findIndex((value) => value >= x);
    if (i < 0) i = xs.length - 1;
    if (i === 0 || xs[i] === x) return ys[i];
    if (ys[i] === null || ys[i - 1] === null) return null;
    return ys[i - 1] + (ys[i] - ys[i - 1]) * (x - xs[i - 1]) / (xs[i] - xs[i - 1]);
  };
  let readouts = 0;
  document.querySelectorAll(".plot-box").forEach((box) => {
    const source = box.querySelector("script.readout");
    if (!source) return;
    const plot = JSON.parse(source.textContent);
    const svg = box.querySelector("svg");
    const output = box.querySelector("output");
    const line = document.createElementNS(SVG, "line");
    line.setAttribute("class", "pointer");
    svg.appendChild(line);
    const [left, top, right, bottom] = plot.box;
    let shown = Math.round((plot.limits[0] + plot.limits[1]) / 2);
    const show = (x) => {
      shown = x;
      const px = left + (x - plot.limits[0]) / (plot.limits[1] - plot.limits[0]) * (right - left);
      Object.entries({x1: px, x2: px, y1: top, y2: bottom}).forEach(([key, value]) => line.setAttribute(key, value));
      const values = plot.series.map(([label, ys]) => {
        const y = valueAt(plot.x, ys, x);
        return label + " " + (y === null ? "not measured" : y.toFixed(plot.digits));
      });
      output.textContent = `${plot.name} ${x}${plot.unit ? " " + plot.unit : ""}: ${values.join(", ")}`;
    };
    svg.addEventListener("pointermove", (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      if (at.x < left || at.x > right) return;
      show(Math.round(plot.limits[0] + (at.x - left) / (right - left) * (plot.limits[1] - plot.limits[0])));
    });
    // By keyboard: arrows move the pointer, with Shift ten times as far; Home and End go to the ends.
    svg.setAttribute("tabindex", "0");
    svg.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 10 : 1;
      const to = {ArrowLeft: shown - step, ArrowRight: shown + step, Home: plot.limits[0], End: plot.limits[1]}[event.key];
      if (to === undefined) return;
      event.preventDefault();
      show(Math.min(Math.max(Math.round(to), plot.limits[0]), plot.limits[1]));
    });
    readouts += 1;
  });
  document.documentElement.dataset.readouts = readouts;
  // A link to what is folded away unfolds it, and one to a card opens that.
  const unfold = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    document.querySelectorAll("details").forEach((each) => { if (each.contains(target)) each.open = true; });
    target.querySelectorAll(":scope > details.on-card").forEach((each) => { each.open = true; });
    target.scrollIntoView({block: "nearest"});
  };
  window.addEventListener("hashchange", unfold);
  document.addEventListener("click", (event) => {      // also where the address is there already
    const link = event.target.closest("a[href^='#']");
    if (link && link.getAttribute("href") === location.hash) unfold();
  });
  // On paper cards are open, and so is what the verdict rests on: both are read there too.
  const folded = ["details.on-card", "details.method", "#conditions"].map((one) => `${one}:not([open])`).join();
  let opened = [];
  window.addEventListener("beforeprint", () => {
    opened = [...document.querySelectorAll(folded)];
    opened.forEach((each) => { each.open = true; });
  });
  window.addEventListener("afterprint", () => opened.forEach((each) => { each.open = false; }));
  // Files that somebody chooses, against the digests and numbers embedded in the page.
  const says = document.getElementById("check-says");
  const hex = async (bytes) => [...new Uint8Array(await crypto.subtle.digest("SHA-256", bytes))]
    .map((byte) => byte.toString(16).padStart(2, "0")).join("");
  const fileSentence = async (file, numbers) => {
    const bytes = await file.arrayBuffer();
    if (file.name === "report.json") {
      const same = new TextDecoder().decode(bytes).trim() === document.getElementById("spectrabox-results").textContent.trim();
      return [same, same ? "report.json holds the numbers of this page." : "report.json holds other numbers than this page."];
    }
    const known = Object.values(numbers.made_from).filter((group) => typeof group === "object")
      .flatMap((group) => Object.entries(group)).concat(numbers.inputs.map((row) => [row.file, row.sha256]));
    const digest = await hex(bytes), match = known.find(([, sha256]) => sha256 === digest);
    if (match) return [true, `${match[0]} is the file that this page was made from.`];
    return [false, known.some(([name]) => name.split("/").pop() === file.name)
      ? `${file.name} is not as it was when this page was made.` : `This page was not made from ${file.name}.`];
  };
  document.getElementById("check-files").addEventListener("change", async (event) => {
    const sentences = [];
    for (const file of event.target.files) sentences.push(await fileSentence(file, numbers));
    says.replaceChildren(...sentences.map(([same, sentence]) => {
      const line = document.createElement("p");
      line.className = same ? "PASS" : "FAIL";
      line.textContent = sentence;
      return line;
    }));
    says.dataset.wrong = sentences.filter(([same]) => !same).length;
  });
  unfold();
}
