"""What calls over XML-RPC raise when nobody answers, or somebody else does."""

import http.client
import xmlrpc.client
from xml.parsers.expat import ExpatError

NO_ANSWER = (OSError, ValueError, http.client.HTTPException, xmlrpc.client.Error, ExpatError)
