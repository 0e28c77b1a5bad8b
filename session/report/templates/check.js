/* Whether tables, plots and pictures show the data of the page, and whether files are those it was made from. */
(() => {
  const UNKNOWN = ["", "–", "not measured", "not stated", "not determined"];
  const NUMBER = /(1\/)?([-+]?\d+)(?:\.(\d+))?(?: × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?(?:e([-+]\d+))?( %)?/;
  const SEEN = ["d", "x", "y", "points", "transform", "style", "href", "xlink:href"];
  const BLANK = /[\x00-\x20\x7f-\xa0\u1680\u2000-\u200f\u2028\u2029\u202f\u205f\u3000\ufeff]+/g;
  const NEAR_PT = 0.3;      // a line is drawn no finer than this, in the drawing's own unit
  const MAX_NAMED = 12;     // places of one kind that are named
  const own = document.getElementById("spectrabox-results");
  const says = document.getElementById("check-says");
  const squeezed = (text) => text.replace(BLANK, "");
  const hex = async (bytes) => [...new Uint8Array(await crypto.subtle.digest("SHA-256", bytes))]
    .map((byte) => byte.toString(16).padStart(2, "0")).join("");
  const steps = (pointer) => pointer.split("/").slice(1)
    .map((part) => part.replaceAll("~1", "/").replaceAll("~0", "~"));
  const valueAt = (data, pointer) => steps(pointer).reduce((value, key) => value?.[key], data);

  const shows = (text, value) => {
    if (typeof value === "string") return squeezed(text) === squeezed(value);
    if (value === null) return UNKNOWN.includes(text.trim());
    const found = NUMBER.exec(text.trim().replaceAll("−", "-"));
    if (typeof value !== "number" || found === null) return false;
    const [, inverse, whole, decimals = "", power = "0", exponent = "0", percent] = found;
    const raised = Number(power.replace(/./g, (sign) => "-0123456789"["⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(sign)] ?? sign));
    const unit = 10 ** (raised + Number(exponent) - decimals.length - (percent ? 2 : 0));
    const wanted = inverse && value ? 1 / value : value;
    return Math.abs(Number(whole + decimals) * unit - wanted) <= 0.5 * unit * (1 + 1e-6) + 1e-12 * Math.abs(wanted);
  };

  // Where an element stands, in words: heading, row and column, or figure.
  const headingOf = (element) => {
    const all = [...document.querySelectorAll("h1, h2, h3, summary, .word")];
    const before = all.filter((one) => one.compareDocumentPosition(element) & Node.DOCUMENT_POSITION_FOLLOWING);
    return before.length ? before[before.length - 1].textContent.trim() : "page";
  };
  const placeOf = (element) => {
    const cell = element.closest("td"), row = element.closest("tr");
    if (!cell) return headingOf(element);
    const head = row.closest("table").tHead?.rows[0].cells[cell.cellIndex];
    const first = [...row.cells].find((one) => one !== cell && one.textContent.trim() && isNaN(one.textContent)) ?? row.cells[0];
    return [headingOf(element), first === cell ? "" : first.textContent.trim(), head?.textContent.trim() ?? ""]
      .filter((each) => each).join(", ");
  };

  const checkCells = (data) => {
    const wrong = [];
    const cells = [...document.querySelectorAll("[data-of]:not(img)")];
    cells.forEach((cell) => {
      const value = valueAt(data, cell.dataset.of);
      const style = cell.childNodes.length ? null : /^(?:width|background): (.*)$/.exec(cell.getAttribute("style"));
      const text = style ? style[1].replace("%", " %") : cell.textContent;
      if (value === undefined) wrong.push(`${placeOf(cell)}: the data have no ${cell.dataset.of}.`);
      else if (!shows(text, value)) wrong.push(`${placeOf(cell)}: the page says “${text.trim()}”, the data ${JSON.stringify(value)} (${cell.dataset.of}).`);
    });
    return {count: cells.length, wrong};
  };

  const checkPictures = async (data) => {
    const wrong = [], shown = new Set();
    for (const image of document.querySelectorAll("img[data-of]")) {
      const bytes = Uint8Array.from(atob(image.src.split(",")[1] ?? ""), (sign) => sign.charCodeAt(0));
      shown.add(image.dataset.of);
      if (valueAt(data, image.dataset.of) !== await hex(bytes)) wrong.push(`Picture “${image.alt}”: it is not the one that was written.`);
    }
    Object.keys(data.pictures).filter((name) => ![...shown].some((pointer) => steps(pointer)[1] === name))
      .forEach((name) => wrong.push(`Picture “${name}” is missing.`));
    return {count: shown.size, wrong};
  };

  const seenOf = (node, pieces = []) => {
    node.childNodes.forEach((child) => {
      if (child.nodeType === Node.TEXT_NODE) pieces.push(squeezed(child.data));
      if (child.nodeType !== Node.ELEMENT_NODE || child.matches("line.pointer, output")) return;
      [...child.attributes].filter((each) => SEEN.includes(each.name)).forEach((each) => pieces.push(squeezed(each.value)));
      seenOf(child, pieces);
    });
    return pieces.filter((piece) => piece);
  };

  // Polylines and points of a drawn series, in the drawing's own unit.
  const drawnOf = (group) => {
    const lines = [...group.querySelectorAll(":scope > path")].flatMap((path) =>
      path.getAttribute("d").split(/(?=M)/).map((part) => part.match(/-?\d+(?:\.\d+)?/g)?.map(Number) ?? [])
        .filter((numbers) => numbers.length > 1)
        .map((numbers) => Array.from({length: numbers.length / 2}, (_, i) => numbers.slice(2 * i, 2 * i + 2))));
    return {lines, points: [...group.querySelectorAll("use")].map((use) => [+use.getAttribute("x"), +use.getAttribute("y")])};
  };
  const toPoint = (axes, x, y) => {
    const [left, top, right, bottom] = axes.box;
    const scale = axes.y_scale === "log" ? Math.log10 : (value) => value;
    const share = (value, [from, to]) => (value - from) / (to - from);
    return [left + share(x, axes.x_limits) * (right - left), bottom - share(scale(y), axes.y_limits.map(scale)) * (bottom - top)];
  };
  const toSegment = ([x, y], [x0, y0], [x1, y1]) => {
    const length = (x1 - x0) ** 2 + (y1 - y0) ** 2;
    const at = length ? Math.min(Math.max(((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length, 0), 1) : 0;
    return Math.hypot(x - x0 - at * (x1 - x0), y - y0 - at * (y1 - y0));
  };
  const toLines = (point, lines) => Math.min(...lines.flatMap((line) =>
    line.length === 1 ? [Math.hypot(point[0] - line[0][0], point[1] - line[0][1])]
      : line.slice(1).map((end, i) => toSegment(point, line[i], end))));
  const toPoints = (point, points) => Math.min(...points.map((one) => Math.hypot(point[0] - one[0], point[1] - one[1])));

  const wrongLine = (axes, line, group) => {
    const drawn = drawnOf(group), runs = [[]];
    const [left, top, right, bottom] = axes.box;
    line.x.forEach((x, i) => {
      if (x === null || line.y[i] === null) { runs.push([]); return; }
      runs[runs.length - 1].push([...toPoint(axes, x, line.y[i]), i]);
    });
    const wanted = runs.filter((run) => run.length);
    const inside = ([x, y]) => x >= left - 0.01 && x <= right + 0.01 && y >= top - 0.01 && y <= bottom + 0.01;
    const far = wanted.flat().find((point) => inside(point)
      && ((drawn.lines.length && toLines(point, drawn.lines) > NEAR_PT)
        || (drawn.points.length && toPoints(point, drawn.points) > NEAR_PT)
        || !(drawn.lines.length + drawn.points.length)));
    if (far) return `at ${line.x[far[2]]} the data have ${line.y[far[2]]}, the plot another value`;
    const strange = [...drawn.lines.flat().filter((point) => toLines(point, wanted) > NEAR_PT),
      ...drawn.points.filter((point) => toPoints(point, wanted.flat()) > NEAR_PT)][0];
    if (!strange) return null;
    const near = axes.x_limits[0] + (strange[0] - left) / (right - left) * (axes.x_limits[1] - axes.x_limits[0]);
    return `near ${Number(near.toPrecision(4))} the plot has a value that the data have not`;
  };
  const wrongBar = (axes, bar, group) => {
    const [x0, y0, x1, y1] = bar.corners, ends = drawnOf(group).lines.flat();
    const wanted = [toPoint(axes, x0, y0), toPoint(axes, x1, y1)];
    const reach = (points, k, most) => (most ? Math.max : Math.min)(...points.map((point) => point[k]));
    const off = [0, 1].some((k) => [true, false].some((most) => Math.abs(reach(ends, k, most) - reach(wanted, k, most)) > NEAR_PT));
    return off ? `the bar is not as long as the data say (${Number((x1 - x0).toPrecision(4))})` : null;
  };

  const checkPlots = async (data) => {
    const wrong = [];
    let series = 0;
    for (const [name, plot] of Object.entries(data.plots)) {
      const box = document.getElementById(name);
      if (!box) { wrong.push(`Plot “${plot.title}” is missing.`); continue; }
      const found = [];
      for (const axes of plot.axes) {
        for (const [kind, check] of [["lines", wrongLine], ["bars", wrongBar]]) {
          for (const one of axes[kind]) {
            const group = document.getElementById(`${name}-${one.id}`);
            const fault = group ? check(axes, one, group) : "it is not drawn";
            series += 1;
            if (fault) found.push(`Plot “${plot.title}”, ${one.label || "a line"}: ${fault}.`);
          }
        }
      }
      const bytes = new TextEncoder().encode(seenOf(box).join("|"));
      if (!found.length && await hex(bytes) !== plot.sha256) found.push(`Plot “${plot.title}”: it is not as it was written.`);
      wrong.push(...found);
    }
    const strange = [...document.querySelectorAll(".plot-box")].filter((box) => !(box.id in data.plots));
    strange.forEach((box) => wrong.push(`Plot “${box.querySelector("title")?.textContent}” is not of these data.`));
    return {count: Object.keys(data.plots).length, series, wrong};
  };

  const differences = (mine, other, pointer = "") => {
    if (mine === other) return [];
    if (mine === null || other === null || typeof mine !== "object" || typeof other !== "object")
      return [`${pointer || "/"}: ${JSON.stringify(mine)?.slice(0, 60)} on the page, ${JSON.stringify(other)?.slice(0, 60)} in the file.`];
    return [...new Set([...Object.keys(mine), ...Object.keys(other)])]
      .flatMap((key) => differences(mine[key], other[key], `${pointer}/${key.replaceAll("~", "~0").replaceAll("/", "~1")}`));
  };

  const checkFile = async (file, data) => {
    const bytes = await file.arrayBuffer();
    if (file.name === "report.json") {
      let other;
      try { other = JSON.parse(new TextDecoder().decode(bytes)); } catch { return {wrong: ["report.json: it is not JSON."]}; }
      const found = differences(data, other);
      return found.length ? {wrong: found.map((each) => `report.json ${each}`)}
        : {right: "report.json: the numbers of this page, every one."};
    }
    const digest = await hex(bytes);
    const known = Object.values(data.made_from).filter((group) => typeof group === "object")
      .flatMap((group) => Object.entries(group)).concat(data.inputs.map((row) => [row.file, row.sha256]));
    const match = known.find(([, sha256]) => sha256 === digest);
    if (match) return {right: `${match[0]}: the file that this page was made from.`};
    return {wrong: [known.some(([name]) => name.split("/").pop() === file.name)
      ? `${file.name}: not as it was when this page was made.` : `${file.name}: this page was not made from such a file.`]};
  };

  const say = (right, wrong) => {
    says.replaceChildren();
    const lead = document.createElement("p");
    lead.className = wrong.length ? "FAIL" : "PASS";
    const word = document.createElement("strong");
    word.className = "word";
    word.textContent = wrong.length ? "They do not agree. " : "They agree. ";
    lead.append(word, wrong.length ? `${wrong.length} found:` : right.join(" "));
    says.append(lead);
    const list = document.createElement("ul");
    wrong.slice(0, MAX_NAMED).forEach((each) => { const item = document.createElement("li"); item.textContent = each; list.append(item); });
    if (wrong.length > MAX_NAMED) { const item = document.createElement("li"); item.textContent = `and ${wrong.length - MAX_NAMED} more`; list.append(item); }
    if (wrong.length) says.append(list);
    says.dataset.wrong = wrong.length;
  };

  const check = async () => {
    const data = JSON.parse(own.textContent);
    const [cells, plots, pictures] = [checkCells(data), await checkPlots(data), await checkPictures(data)];
    return {wrong: [...cells.wrong, ...plots.wrong, ...pictures.wrong],
      right: [`${cells.count} entries of tables, ${plots.count} plots with ${plots.series} lines and bars, and ${pictures.count} pictures show the data of this page.`]};
  };
  document.getElementById("check-page").addEventListener("click", async () => {
    const {right, wrong} = await check();
    say(right, wrong);
  });
  document.getElementById("check-files").addEventListener("change", async (event) => {
    const data = JSON.parse(own.textContent), right = [], wrong = [];
    for (const file of event.target.files) {
      const found = await checkFile(file, data);
      if (found.right) right.push(found.right);
      wrong.push(...(found.wrong ?? []));
    }
    const shown = await check();
    if (event.target.files.length) say([...right, ...shown.right], [...wrong, ...shown.wrong]);
  });
})();
