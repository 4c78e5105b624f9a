// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/request_handler.h"

#include <spdlog/spdlog.h>

#include <bit>

#include "core/metrics/exposition.h"
#include "core/util/machine.h"
#include "dashboard/http/server_context.h"

namespace citylearn {
namespace {

/// Returns a page for people who opened a link. It has no style, as the policy forbids style outside of files.
Reply html_page(int status, const std::string& title, const std::string& text) {
  Answer answer;
  answer.status = status;
  answer.type = "text/html; charset=utf-8";
  answer.body = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" + title +
                "</title></head>\n<body><h1>" + title + "</h1>\n<p>" + text + "</p></body></html>\n";
  return {answer, {}};
}

}  // namespace

Reply error_reply(int status, const std::string& what) { return {error_answer(status, what), {}}; }

std::optional<Reply> RequestHandler::refusal(const RequestHead& head, const std::optional<Target>& target) const {
  if (const auto why = context_.access->foreign(head.credentials)) return error_reply(403, *why);
  const bool api = target && target->segments[0] == "api";
  const bool known = head.method == "GET" || head.method == "HEAD" || (api && head.method == "DELETE");
  if (!known) {
    Reply reply = error_reply(405, "the method is not allowed: " + std::string(head.method));
    reply.answer.headers.emplace_back("Allow", api ? "GET, HEAD, DELETE" : "GET, HEAD");
    return reply;
  }
  if (!target) return error_reply(400, "the path or a parameter of it is not properly percent-encoded UTF-8");
  if (!target->repeated.empty()) return error_reply(400, "parameter '" + target->repeated + "' is given twice");
  const bool data = api || target->path == "/metrics";
  // Any page that is open in a browser may name an address here as its image: such a request has no Origin.
  if (data && !head.fetch_site.empty() && head.fetch_site != "same-origin" && head.fetch_site != "none")
    return error_reply(403,
                       "Sec-Fetch-Site '" + std::string(head.fetch_site) + "': this is for the dashboard's own page");
  if (data && !context_.access->allows(head.credentials)) return unauthorised(head);
  return std::nullopt;
}

void RequestHandler::report_guess(const RequestHead& head) const {
  // More rarely as they go on, so that nobody fills the log.
  if (std::has_single_bit(++context_.guesses))
    spdlog::warn("a wrong token or login link came from {} ({} so far)", head.client, context_.guesses);
}

Reply RequestHandler::unauthorised(const RequestHead& head) const {
  if (!head.credentials.authorization.empty()) report_guess(head);
  Reply reply = error_reply(401, "this needs the token: 'Authorization: Bearer TOKEN', or the link that was printed");
  reply.answer.headers.emplace_back("WWW-Authenticate", "Bearer");
  return reply;
}

Reply RequestHandler::reply(const RequestHead& head, const Target& target) const {
  if (target.path == "/healthz" || target.path == "/livez") {
    const auto& ask = context_.handlers.problem;
    const std::string problem = ask ? ask(target.path == "/healthz") : "";
    Reply reply;
    reply.answer.status = problem.empty() ? 200 : 503;
    reply.answer.type = "text/plain; charset=utf-8";
    reply.answer.body = problem.empty() ? "ok\n" : problem + "\n";
    return reply;
  }
  if (target.path == "/login") return login(head, target);
  const Page::File* file = context_.page.find(target.path);
  if (!file && target.path == "/" && context_.page.empty())
    return html_page(
        404, "The page is not built",
        "The dashboard runs and answers under /api/, but the page's files are not there. Install Node.js "
        "and npm, then build the target <code>page</code> (<code>./run build</code>), or name their folder "
        "with <code>--page</code>.");
  if (!file) return error_reply(404, "there is nothing at " + target.path);
  Reply reply;
  reply.answer.type = file->type;
  auto& headers = reply.answer.headers;
  headers.emplace_back("Cache-Control", file->hashed ? "public, max-age=31536000, immutable" : "no-cache");
  headers.emplace_back("ETag", file->tag);
  if (head.if_none_match.find(file->tag) != std::string_view::npos) {
    reply.answer.status = 304;
    return reply;
  }
  reply.file = file->body;
  if (!file->compressed.empty()) {
    headers.emplace_back("Vary", "Accept-Encoding");
    if (head.accept_encoding.find("gzip") != std::string_view::npos) {
      headers.emplace_back("Content-Encoding", "gzip");
      reply.file = file->compressed;
    }
  }
  return reply;
}

Reply RequestHandler::login(const RequestHead& head, const Target& target) const {
  Access& access = *context_.access;
  Reply home = html_page(303, "Welcome", "The dashboard is at <a href=\"/\">/</a>.");
  home.answer.headers.emplace_back("Location", "/");
  if (!access.needs_token()) return home;
  const auto code = target.parameters.find("once");
  if (code == target.parameters.end()) {
    // The page asks the user for the token; from then on the WebSocket has the cookie.
    if (!access.allows(head.credentials)) return unauthorised(head);
    Reply reply;
    reply.answer.status = 204;
    reply.answer.headers.emplace_back("Set-Cookie", access.cookie());
    return reply;
  }
  if (head.method != "GET") return error_reply(405, "a link is used with GET");
  if (!access.redeem(code->second)) {
    report_guess(head);
    return html_page(401, "This link is not valid",
                     "It works once. The token itself opens the dashboard too: it is in the token file.");
  }
  home.answer.headers.emplace_back("Set-Cookie", access.cookie());
  return home;
}

std::string RequestHandler::metrics() const {
  Exposition lines;
  const auto add = [&](const std::string& name, const char* help, std::uint64_t value) {
    lines.single("citylearn_dashboard_" + name, help, static_cast<double>(value));
  };
  const auto counts = context_.hub.counts();
  add("connections", "Open connections.", context_.connections.size());
  add("connections_total", "Connections accepted.", context_.accepted);
  add("connections_refused_total", "Connections refused, as too many were busy.", context_.refused);
  add("connections_made_room_total", "Idle connections closed for newcomers.", context_.connections.made_room());
  add("guesses_total", "Requests with a wrong token or login link.", context_.guesses);
  add("live_clients", "WebSocket clients.", counts.clients);
  add("live_messages_total", "Messages published on watched topics.", counts.published);
  add("live_frames_total", "Frames taken by WebSocket clients.", counts.taken);
  add("live_dropped_total", "Messages (of training: rows) that WebSocket clients lost.", counts.dropped);
  add("live_bytes_total", "Bytes of the frames sent.", context_.frame_bytes);
  add("live_let_go_total", "WebSocket clients closed as they neither took nor sent anything.", context_.timed_out);
  add("live_broken_total", "WebSocket clients closed for malformed frames or messages.", context_.malformed);
  lines.family("citylearn_dashboard_requests_total", "Requests answered, by status.");
  for (const auto& [status, count] : context_.answers)
    lines.sample(static_cast<double>(count), "{" + metric_label("status", std::to_string(status)) + "}");
  lines.single("process_cpu_seconds_total", "User and system time.", process_use().processor_seconds);
  return lines.text();
}

}  // namespace citylearn
