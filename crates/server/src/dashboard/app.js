// Lists the newest jobs and keeps the list fresh.
const rows = document.getElementById("jobs");

function cell(content) {
  const td = document.createElement("td");
  td.append(content);
  return td;
}

function link(href, text) {
  const a = document.createElement("a");
  a.href = href;
  a.textContent = text;
  return a;
}

async function refresh() {
  try {
    const page = await (await fetch("/v1/jobs?limit=20")).json();
    rows.replaceChildren(...page.jobs.map((job) => {
      const tr = document.createElement("tr");
      const error = job.estimated_error === null ? "–" : `${(100 * job.estimated_error).toFixed(2)} %`;
      const picture = job.result ? link(`/v1/jobs/${job.id}/image.png`, "PNG") : "–";
      tr.append(cell(link(`/v1/jobs/${job.id}`, job.id)), cell(job.state), cell(String(job.iterations)), cell(error), cell(picture));
      return tr;
    }));
  } finally {
    setTimeout(refresh, 2000);
  }
}

refresh();
