// Sessions of the working folder, and photos that become one.
const $ = (id) => document.getElementById(id);
const say = (text) => { $("said").textContent = text; };
const token = handedToken();

function handedToken() {
  const given = new URLSearchParams(location.search).get("token");
  if (given === null) return sessionStorage.getItem("token") ?? "";
  sessionStorage.setItem("token", given); history.replaceState(null, "", "/page");
  return given;
}

async function ask(path, body, method = body === undefined ? "GET" : "POST") {
  const answer = await fetch(path, { method, body, headers: { Authorization: `Bearer ${token}` } });
  const said = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(said.error ?? `${answer.status}`);
  return said;
}

async function show(path, asked) {
  try { location.assign((await ask(path, JSON.stringify(asked))).address); }
  catch (error) { say(error.message); }
}

async function take(files) {
  try {
    for (const file of files) { say(`copying ${file.name} …`); await ask(`/api/photo?name=${encodeURIComponent(file.name)}`, file); }
    if (files.length) await show("/api/new", { names: files.map(({ name }) => name) });
  } catch (error) { say(error.message); }
}

const drop = document.body;
for (const kind of ["dragover", "dragleave", "drop"]) drop.addEventListener(kind, (event) => {
  event.preventDefault(); $("drop").classList.toggle("over", kind === "dragover");
  if (kind === "drop") take([...event.dataTransfer.files]);
});
$("files").addEventListener("change", () => take([...$("files").files]));
const { folder, sessions } = await ask("/api/sessions");
$("folder").textContent = sessions.length ? `in ${folder}` : `none in ${folder} yet`;
$("sessions").replaceChildren(...sessions.map((name) => {
  const item = document.createElement("li"), button = document.createElement("button");
  button.textContent = name; button.addEventListener("click", () => show("/api/open", { name }));
  item.append(button); return item;
}));
