// Sessions of the working folder, and photos that become one.
import { $, button, make } from "./dom.js";
import { get, post, upload } from "./server.js";
const say = (text) => { $("said").textContent = text; };

async function show(path, asked) {
  try { location.assign((await post(path, asked)).address); }
  catch (error) { say(error.message); }
}

async function take(files) {
  try {
    for (const file of files) { say(`copying ${file.name} …`); await upload(file, "/api/photo"); }
    if (files.length) await show("/api/new", { names: files.map(({ name }) => name) });
  } catch (error) { say(error.message); }
}

for (const kind of ["dragover", "dragleave", "drop"]) document.body.addEventListener(kind, (event) => {
  event.preventDefault(); $("drop").classList.toggle("over", kind === "dragover");
  if (kind === "drop") take([...event.dataTransfer.files]);
});
$("files").addEventListener("change", () => take([...$("files").files]));
const { folder, sessions } = await get("/api/sessions");
$("folder").textContent = sessions.length ? `in ${folder}` : `none in ${folder} yet`;
$("sessions").replaceChildren(...sessions.map((name) => make("li", {}, button(name, () => show("/api/open", { name })))));
