// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "dashboard/http/access.h"
#include "dashboard/http/answer.h"
#include "dashboard/http/target.h"

namespace citylearn {

struct ServerContext;

/// The fields of a request's header that the dashboard reads. An empty field is absent.
struct RequestHead {
  std::string_view method;
  Access::Request credentials;
  std::string_view if_none_match, accept_encoding;
  std::string_view fetch_site;  ///< Sec-Fetch-Site: where a browser's request comes from
  std::string client;           ///< the address that it comes from
};

/// An answer on its way out.
struct Reply {
  Answer answer;
  std::string_view file;  ///< a file of the page, sent in place of answer.body; it outlives the reply
};

Reply error_reply(int status, const std::string& what);

/// Answers all requests but those of the API: access, the page, the login, metrics. Used by the server's thread.
class RequestHandler {
 public:
  explicit RequestHandler(ServerContext& context) : context_(context) {}

  /// Returns why the request is refused, or nothing when it is authorised.
  std::optional<Reply> refusal(const RequestHead& head, const std::optional<Target>& target) const;
  /// Answers a request that is neither the API's nor of /metrics.
  Reply reply(const RequestHead& head, const Target& target) const;
  /// Returns the lines of /metrics that the server knows.
  std::string metrics() const;

 private:
  /// Counts a wrong token or login link.
  void report_guess(const RequestHead& head) const;
  Reply unauthorised(const RequestHead& head) const;
  Reply login(const RequestHead& head, const Target& target) const;

  ServerContext& context_;
};

}  // namespace citylearn
