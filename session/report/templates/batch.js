/* A heading sorts the sessions by its column, pressed again the other way round. */
(() => {
  const body = document.querySelector("#sessions tbody");
  const numeric = new Set(["verdict", "seconds"]);
  const compare = (key) => (a, b) => numeric.has(key) ? a.dataset[key] - b.dataset[key]
    : a.dataset[key].localeCompare(b.dataset[key], undefined, { numeric: true });
  document.querySelectorAll("button[data-sort]").forEach((button) => button.addEventListener("click", () => {
    const key = button.dataset.sort, again = button.getAttribute("aria-pressed") === "true" && !button.dataset.reversed;
    document.querySelectorAll("button[data-sort]").forEach((one) => {
      one.setAttribute("aria-pressed", one === button); delete one.dataset.reversed; });
    if (again) button.dataset.reversed = "yes";
    const rows = [...body.rows].sort(compare(key));
    body.append(...(again ? rows.reverse() : rows));
  }));
})();
