// Talking to the server that served this page: the token, questions, files.
export const base = location.pathname.replace(/\/(page)?$/, "");     // of this session, where one server has several
const token = handedToken();
export const headers = { Authorization: `Bearer ${token}` };

// The token leaves the address bar; this tab keeps it, so that the page can be loaded again.
function handedToken() {
  const given = new URLSearchParams(location.search).get("token");
  if (given === null) return sessionStorage.getItem("token") ?? "";
  sessionStorage.setItem("token", given); history.replaceState(null, "", `${base}/page`);
  return given;
}

export async function ask(path, options = {}) {
  const answer = await fetch(base + path, { ...options, headers });
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).error ?? `${answer.status}`);
  return answer;
}
export const get = async (path) => (await ask(path)).json();
export const post = async (path, body) => (await ask(path, { method: "POST", body: JSON.stringify(body) })).json();

// A file into the session's folder, or onto the start page; its name there.
export async function upload(file, path = "/api/file", name = file.name) {
  return (await (await ask(`${path}?name=${encodeURIComponent(name)}`, { method: "POST", body: file })).json()).file;
}

// An address that a link or a frame opens, which sends no headers.
export function address(path, about = {}) {
  return `${base}${path}?${new URLSearchParams({ ...about, token })}`;
}
