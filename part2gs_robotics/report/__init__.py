"""What a build found, for people and for programs.

In: `data.ReportData`. Out: report.json and report.html.
Call: `report_json.write_report`.
"""
